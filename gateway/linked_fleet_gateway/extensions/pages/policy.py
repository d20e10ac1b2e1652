"""The policy of pages (Content Security Policy Level 3): run our scripts, speak to us, and nothing else."""

POLICY = "; ".join(
    (
        "default-src 'none'",
        "script-src 'self'",
        "style-src 'self'",
        "img-src 'self' data: blob:",  # textures inside of meshes become object URLs
        "connect-src 'self'",
        "base-uri 'none'",
        "form-action 'none'",
        "frame-ancestors 'none'",
    )
)

FORMS = POLICY.replace("form-action 'none'", "form-action 'self'")
"""The policy of pages that can send a form without a script: those where people log in or out."""
