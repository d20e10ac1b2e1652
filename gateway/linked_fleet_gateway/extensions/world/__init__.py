"""World: placements, objects and zones, poses between frames, and the collision check of motions (README.md).

``service``, ``resources``, ``describe``, ``page``: what is at ``/world``. ``store``, ``replicated_objects``: objects in
Redis and this gateway's copy. ``checks``: the guard of motions; it asks ``worker``, a process of its own, through
``process`` and ``messages``. There ``preparation``, ``shapes``, ``surfaces`` and ``mesh_cache`` make shapes of URDFs,
``pairs`` finds which parts are held against each other, ``path``, ``swept_path`` and ``collision_check`` follow a way.
"""
