"""History: the last minutes of each robot, in a bounded memory, decoded for who asks (README.md)."""
