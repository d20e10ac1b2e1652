"""Foxglove live: robots, objects and cameras in the protocol of Foxglove (README.md)."""
