"""Base: errors, lazy imports and IP networks. Every package may import it.

``errors``: every refusal of the core with its status and problem type (RFC 9457); extensions add their own.
"""
