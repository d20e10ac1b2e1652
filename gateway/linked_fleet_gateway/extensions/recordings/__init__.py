"""The extension ``recordings``: keeps the last 30 s of a robot before a failure, a stop or a fault (README.md)."""
