"""HTTP: methods, negotiation, conditional requests, links, errors, streams and audit of every resource.

``server``, ``protocol``, ``websocket_protocol``, ``exchange``, ``timeouts``, ``sockets``, ``backpressure``, ``tls``:
the server, with bounds of time and number. Middleware, the outermost first: ``forwarded``,
``operator_endpoints`` (``health``), ``cors``, ``host``, ``callers``, ``rates``, ``lazy_imports``.
``request``: the typed request and its gateway.
``endpoint``: the one way of every request; ``read``, ``representation``, ``preconditions``, ``links``, ``problem``
answer it, ``answers`` keeps answers, ``encoding`` compresses them; ``invoke``, ``control``, ``subscribe``,
``subscription_change``, ``patch`` write; ``streams``, ``event_stream``, ``websocket`` stream. ``extension``: the
contract of extensions; ``authentication`` and ``html`` are its seams. ``offload`` reads long bodies in a thread,
``stop_priority`` lets a stop overtake all that wait.
"""
