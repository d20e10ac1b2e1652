"""Cameras: cameras of robots as resources, their pictures, and streams of them (README.md)."""
