"""Fuzzing with millions of hostile inputs, and a soak test of an hour: `make fuzz`, `make soak` (docs/FUZZING.md)."""
