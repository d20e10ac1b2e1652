"""A queue of missions, which robots take in turn, and schedules that put missions into it. See README.md."""
