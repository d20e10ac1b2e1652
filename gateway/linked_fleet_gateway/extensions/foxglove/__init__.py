"""The extension ``foxglove``: robots, objects and cameras in the live protocol of Foxglove (README.md)."""
