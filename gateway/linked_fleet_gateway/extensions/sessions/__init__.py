"""Sessions: people log in by a browser, with a token or at an issuer (OpenID Connect), and stay logged in.

``scheme``: authentication by the cookie. ``login``: the pages. ``sealed_cookie``, ``session_key``, ``ended_sessions``:
what a browser keeps, the key that seals it, and the sessions whose owners have logged out.
"""
