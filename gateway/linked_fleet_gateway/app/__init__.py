"""App: the composition root.

``application``: settings → parts → one ASGI application. ``extensions``: discovery, ordering and mounting of
extensions. ``settings``: environment variables and flags, and what a gateway needs that other machines reach.
``metrics``: the metrics of one gateway. ``main``: its process.
"""
