"""Errors, settings, records, lazy imports and faults, which every package of the gateway may import. Pure.

``errors``: every refusal of the core with its status and problem type (RFC 9457); extensions add their own.
``settings``: sections of typed settings. ``lazy_imports``: modules imported on first use.
"""
