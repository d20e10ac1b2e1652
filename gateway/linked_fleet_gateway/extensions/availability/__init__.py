"""Robots that people take out of service, and return. See README.md."""
