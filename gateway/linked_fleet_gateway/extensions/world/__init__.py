"""World: placements, objects and zones, poses between frames, and collision checks of motions (README.md).

``extension``: HTTP. ``service``: objects and map in Redis and this gateway's copy. ``placement``, ``scene``: placements
and objects as typed values. ``relocalise``: the action that corrects the placement of a base. ``floor_map``,
``map_yaml``, ``map_image``, ``form_data``: the map of the floor and its files; ``occupancy``: its cells, for planners.
``resources``, ``descriptions``, ``map_resources``, ``map_requests``, ``page``: the resources at ``/world``. ``checks``:
the guard of motions; it queries ``check_process``, which runs ``worker``, through ``process`` and ``messages``.
``collisions``: the motions that it refused. In that process, ``shapes`` and ``surfaces`` build collision shapes from
URDFs, ``map_obstacles`` those of the map, ``robot`` selects the pairs of bodies to check, and ``path``,
``surroundings`` and ``collision_check`` check a path.
"""
