"""Runtime: everything that needs asyncio, Redis or a child process. Pure packages do not import it.

``redis``: the connection to Redis or Valkey, one server or a cluster; the only module that imports redis.
``embedded_redis``: the server that a gateway starts if none is configured; ``damaged_data`` keeps data that it cannot
load. ``background``: supervised loops; ``cancellation``: reliable end of tasks. ``worker``: child processes.
``replica``: state shared through Redis, and this gateway's copy. ``time_slices``: long work on the event loop.
``audit_log``: audit records, in the log and in Redis. ``request_context``, ``log``, ``tracing``: the current request,
log formats, spans. ``counters``, ``metrics``: counters, and their Prometheus form.
"""
