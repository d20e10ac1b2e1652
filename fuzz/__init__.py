"""Hostile inputs by the million, and an hour of everything at once: `make fuzz`, `make soak` (docs/FUZZING.md)."""
