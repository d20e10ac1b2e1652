"""Base: errors, settings, lazy imports and faults. Every package may import it.

``errors``: every refusal of the core with its status and problem type (RFC 9457); extensions add their own.
``settings``: sections of typed settings. ``lazy_imports``: modules imported on first use.
"""
