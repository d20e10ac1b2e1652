"""Sessions: browser login with a token or at an issuer (OpenID Connect).

``extension``: authentication by the cookie. ``login``: the pages. ``cookies``, ``sealed_cookie``: cookies and their
content. ``service``: the key that seals them, and the sessions that were logged out.
"""
