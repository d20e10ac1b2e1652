"""App: the composition root.

``application``: settings → parts → one ASGI application. ``extensions``: discovery, ordering and mounting of
extensions. ``settings``: environment variables and flags. ``exposure``: requirements of a gateway that other machines
reach. ``shape_check``: compilation of all shapes at start. ``metrics``, ``sampler``: the metrics of one gateway.
``doctor``: checks of the environment of a gateway.
"""
