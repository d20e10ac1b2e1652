"""Fixtures of the tests below."""

from gateway_fixtures import bench, every_extension  # noqa: F401 - fixtures
