"""Actions: execution of plans (protocol: PROTOCOL.md beside this file).

``admission``: validation of a body by the shape that the action's description links. ``handler_table``,
``action_handlers``: conversion of a validated body (``action_request``) into a ``plan``, without side effects.
``service``: plan → invocation in Redis → command → agent's reply → progress → end, after the guards of motions.
``replicated_invocations``: this gateway's copy of invocations, leases and settings. ``quota``, ``stall_detector``,
``waiting``, ``refusals``: limits, and errors for refusals. ``store``, ``redis_keys``, ``redis_scripts``: Redis.
"""
