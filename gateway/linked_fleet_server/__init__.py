"""The HTTP server: connections, HTTP/1.1, WebSockets and TLS, with limits of time, size and number.

``server``: uvicorn's server, which accepts connections and ends them, with our protocol classes. ``protocol``: a
connection of HTTP/1.1; ``request_reader`` reads its requests with httptools, and ``exchange`` is one request and its
response. ``websocket_protocol``: a connection of WebSockets, whose frames are those of websockets. ``connection``: what
both have. ``message_heads``: heads of requests and responses. ``connection_limits``: number of connections, deadlines,
bytes that wait for readers. ``addresses``: the network of a client. ``tls``: encrypted connections, and certificates
that are replaced.

It knows no resource and imports nothing of the gateway: its application is an ASGI application with one more method,
``reply_nowait``, which returns responses that are ready.
"""
