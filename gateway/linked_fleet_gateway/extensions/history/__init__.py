"""History: recent frames of each robot in bounded memory, decoded on demand (README.md)."""
