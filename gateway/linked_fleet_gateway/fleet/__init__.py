"""Fleet: live state of robots. Pure; clocks are passed in.

``fleet``: ``apply(event) -> changes``. ``frames``, ``events``: hand-over from the threads of the transport.
``robot``: one robot as the gateway knows it. ``presence``, ``description_queue``: tokens and descriptions of agents,
bounded in memory, queries and time. ``model``, ``kinematics``: the URDF as a tree, link poses from it (metre,
radian), and spheres that contain all reachable positions. ``invocations``, ``invocation``: state of actions, and
control of robots. ``limits``, ``observation``: positions outside their limits, and detection of changed values.
"""
