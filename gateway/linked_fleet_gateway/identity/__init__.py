"""Identity: callers, rights and tokens.

``rights``: who may do what, and to which robots; pure. ``roster``: the file of identities. ``jwts``, ``keys``, ``web``:
tokens of issuers and the keys that verify them. ``service``: the file as it is now, and what ends when a right ends.
``python -m linked_fleet_gateway.identity`` makes a token. Sessions of browsers are the extension ``sessions``.
"""
