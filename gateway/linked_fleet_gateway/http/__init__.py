"""HTTP: methods, negotiation, conditional requests, links, errors, streams and audit of every resource.

``server``, ``protocol``, ``websocket_protocol``, ``exchange``, ``timeouts``, ``sockets``, ``backpressure``, ``tls``:
the server, with limits of time and number. Middleware, outermost first: ``forwarded``, ``operator_endpoints``
(``health``), ``cors``, ``host``, ``callers``, ``rates``, ``lazy_imports``. ``request``: the typed request and its
gateway. ``endpoint``: dispatches every request; ``read``, ``representation``, ``preconditions``, ``links``, ``problem``
answer it, ``answers`` caches responses, ``encoding`` compresses them; ``invoke``, ``control``, ``subscribe``,
``subscription_change``, ``patch`` write; ``streams``, ``event_stream``, ``websocket`` stream. ``extension``: the
interface of extensions; ``authentication`` and ``html`` are further interfaces for them. ``offload`` parses long bodies
in a thread, ``stop_priority`` lets a stop overtake waiting requests.
"""
