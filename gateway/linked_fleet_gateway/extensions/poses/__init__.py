"""Poses: positions of joints that people save under a name. See README.md."""
