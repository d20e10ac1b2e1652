"""The live state of a fleet, without HTTP and RDF. Pure; clocks are passed in.

``fleet``: ``apply(event) -> changes``. ``events``: hand-over from the threads of the transport, and latest frames.
``robot``: one robot as the gateway knows it. ``presence``: tokens and descriptions of agents, bounded in memory,
queries and time. ``answers``: answers of agents, and the count of refused messages. ``model``, ``xml``, ``kinematics``:
the URDF as a tree, and link poses from it (metre, radian). ``pinocchio_model``: the URDF for
Pinocchio. ``invocations``, ``invocation``: state of actions, and control of robots. ``observation``, ``movement``,
``limit_watch``: detection of changed values, of movement, and of positions that are, or stay, outside their limits.
``functions``: functions over robots that extensions offer to query languages.
"""
