"""Tasks, Redis and its tables, child processes, logs and metrics. Pure packages do not import them.

``redis``: the connection to Redis or Valkey, one server or a cluster; the only module that imports redis;
``redis_exchange`` sends commands to one server; ``store_marker`` notices that it has lost its data. ``background``:
supervised loops, reliable end of tasks, long work in slices. ``worker``: child processes. ``replica``: state shared
through Redis, and this gateway's copy. ``log``, ``tracing``: the current request, log formats, spans. ``metrics``:
counters, and their Prometheus form.

Leases are not one class. All three expire as a key in Redis, but who compares and who is told differ. The lease of a
robot (``actions.redis_scripts``) belongs to a client with a secret token, and is checked in the script that opens an
invocation, in the slot of the robot. The lease of a run of a gateway (``subscriptions.records``) is judged by every
other run with its own monotonic clock, so that an outage of Redis ends no run. The lease of rules has one holder, and
each step of it checks the holder in the slot of the rules. Only ``SET`` with an expiry is common to them.

Work is divided in two ways: ``background.time_sliced`` in a task, ``background.Turns`` in callbacks. Two other things
called turns are queues with other purposes: ``http.scheduling`` admits one request per iteration of the event loop, so
that a stop overtakes the others, and the fair turns of queries bound the work of a child process per client.
"""
