"""Boards: saved charts of values of several robots. See README.md."""
