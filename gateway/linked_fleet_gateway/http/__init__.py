"""HTTP: methods, negotiation, conditional requests, links, errors and streams of every resource.

``entrance``: the layer in front of all resources, with ``forwarding`` (client and public URL), ``operator_endpoints``
and ``callers``; ``arrival``: the facts that it finds. ``request``: the typed
request and its gateway. ``endpoint``: dispatches every request; ``read``, ``representation``, ``negotiation``,
``preconditions``, ``problem`` answer it, ``answers`` caches responses; ``invoke``, ``subscribe``,
``subscription_change``, ``writes`` write what ``body`` parses; ``streams``, ``event_stream``, ``websocket`` stream.
``fields``: the grammar of header fields. ``scheduling`` processes long bodies in a thread, and lets a stop overtake
waiting requests. ``request_events``: events of requests, for those who listen.

``extension``: the interface of extensions; ``arrival.Scheme`` is a further interface for them. ``content`` answers with
what they have made themselves, ``internal_request`` sends requests for them, and ``hosted`` passes requests to ASGI
applications of other packages.
"""
