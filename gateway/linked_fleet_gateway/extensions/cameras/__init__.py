"""Cameras: cameras of robots as resources, their pictures, and streams of them (docs/CAMERAS.md)."""
