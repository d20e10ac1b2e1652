"""World: placements, objects and zones, poses between frames, and collision checks of motions (README.md).

``service``, ``resources``, ``describe``, ``page``: the resources at ``/world``. ``store``, ``replicated_objects``:
objects in Redis and this gateway's copy. ``checks``: the guard of motions; it queries ``worker``, a separate process,
through ``process`` and ``messages``. In that process, ``preparation``, ``shapes``, ``surfaces`` and ``mesh_cache``
build collision shapes from URDFs, ``pairs`` selects the pairs of bodies to check, and ``path``, ``swept_path`` and
``collision_check`` check a path.
"""
