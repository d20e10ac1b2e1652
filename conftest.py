"""The fixtures of all tests, wherever these are."""

pytest_plugins = ("shared_fixtures", "gateway_group_fixtures")
