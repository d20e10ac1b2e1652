"""Fleet: live state of robots. Pure; clocks are handed in.

``fleet``: ``apply(event) -> changes``. ``frames``, ``inbox``: the hand-over from the threads of the transport.
``robot``: one robot as the gateway knows it. ``presence``, ``silences``, ``description_queue``: tokens and descriptions
of agents, bounded in memory, in questions and in time. ``model``, ``kinematics``, ``envelope``: the URDF as a tree,
link poses from it (metre, radian), balls around all that joints can reach. ``invocations``, ``lease``: what became of
actions, who has control. ``limits``, ``observation``: positions outside their limits, and what counts as change.
"""
