"""Runtime: whatever needs asyncio, Redis or a child process. Pure rooms do not import it.

``redis``: the connection to Redis or Valkey, one server or a cluster; the only module that imports redis.
``embedded_redis``: the server that a gateway starts where none is named; ``damaged_data`` keeps what it cannot load.
``background``: loops that go on whatever happens; ``cancellation``: tasks ended for certain.
``worker``: child processes. ``replica``: state that gateways share through Redis, and this gateway's copy.
``time_slices``: long work on the event loop. ``audit_log``: who did what, in the log and in Redis.
``request_context``, ``log``, ``tracing``: the request under way, lines of the log, spans.
``counters``, ``metrics``: numbers where they are counted, and as Prometheus reads them.
"""
