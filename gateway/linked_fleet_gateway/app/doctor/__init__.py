"""Doctor: checks, before a gateway is started or while one runs, of all that it needs on this machine and around it.

``finding``: one result. ``ports``, ``certificates``, ``redis_server``, ``zenoh_routers``, ``clocks``: the checks.
"""
