"""Doctor: checks of everything that a gateway needs on this machine and around it, before or while it runs.

``finding``: one result. ``machine``, ``certificates``, ``redis_server``, ``zenoh_routers``, ``libraries``: the checks.
"""
