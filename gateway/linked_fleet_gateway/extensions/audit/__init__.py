"""Audit: who has commanded and changed what, in the log and as the resource ``/audit`` (docs/IDENTITIES.md)."""
