"""App: the composition root.

``application``: settings → parts → one ASGI application. ``extensions``: extensions found, put in order and mounted.
``settings``: environment variables and flags. ``exposure``: what a gateway that other machines reach must have.
``shape_check``: shapes are compiled before a gateway serves. ``metrics``, ``sampler``: the numbers of one gateway.
``doctor``: checks of all that a gateway needs.
"""
