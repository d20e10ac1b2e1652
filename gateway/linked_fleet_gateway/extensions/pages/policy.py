"""The Content Security Policy (Level 3) of pages: only this gateway's scripts and connections are allowed."""

POLICY = "; ".join(
    (
        "default-src 'none'",
        "script-src 'self'",
        "style-src 'self'",
        "img-src 'self' data: blob:",  # textures inside meshes become object URLs
        "connect-src 'self'",
        "base-uri 'none'",
        "form-action 'none'",
        "frame-ancestors 'none'",
    )
)

FORMS = POLICY.replace("form-action 'none'", "form-action 'self'")
"""The policy of pages with a form that works without scripts: those for logging in and out."""
