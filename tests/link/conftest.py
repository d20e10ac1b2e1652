"""Runs each contract test with both implementations: Zenoh itself and the in-memory network."""

import pytest

from link.parts import Memory, Zenoh


@pytest.fixture(params=[Memory, Zenoh])
def part(request: pytest.FixtureRequest) -> type:
    return request.param
