"""Callers, their rights and their tokens.

``rights``: rights of callers, and the robots that they hold for; pure. ``roster``: the file of identities. ``issuers``:
tokens of issuers and the keys that verify them. ``service``: reloads the file, and ends streams when a right ends.
``python -m linked_fleet_identity`` creates a token. Browser sessions are the extension ``sessions``.
"""
