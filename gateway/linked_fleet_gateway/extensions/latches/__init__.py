"""Stops that hold until a person resets them. See README.md."""
