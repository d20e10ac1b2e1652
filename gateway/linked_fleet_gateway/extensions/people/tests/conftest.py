"""Fixtures of the tests below."""

from identity_fixtures import here, issuer  # noqa: F401 - fixtures
