"""Sessions: browser login with a token or at an issuer (OpenID Connect).

``scheme``: authentication by the cookie. ``login``: the pages. ``sealed_cookie``, ``session_key``, ``ended_sessions``:
the content of cookies, the key that seals them, and the sessions that were logged out.
"""
