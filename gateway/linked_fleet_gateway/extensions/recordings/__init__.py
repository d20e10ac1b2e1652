"""Recordings: the last 30 s of a robot, kept when a motion failed or somebody stopped it (README.md)."""
