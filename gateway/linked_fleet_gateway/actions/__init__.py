"""Actions: plans carried out (protocol: PROTOCOL.md beside this file).

``admission``: the guard of a body, which is the shape that the action's description links. ``action_handlers``: from an
admitted body to a ``plan``, in which nothing has happened yet. ``execution``: from an offer to its invocation, for
requests and extensions. ``service``, ``lifecycle``: plan → invocation in Redis → command → word of the agent → progress
→ end; guards of motions come before. ``replicated_invocations``: this gateway's copy of invocations, leases and
settings. ``stop_delivery``: stops, until agents confirm them. ``refusals``: bounds, and how refusals are answered.
``store``, ``owed_stop_table``, ``redis_scripts``: Redis.
"""
