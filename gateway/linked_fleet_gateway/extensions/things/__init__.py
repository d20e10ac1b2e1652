"""Things: Thing Descriptions and their directory (W3C Web of Things; README.md)."""
