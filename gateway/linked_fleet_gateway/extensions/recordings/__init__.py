"""The extension ``recordings``: keeps the last 30 s of a robot when a motion fails or is stopped (README.md)."""
