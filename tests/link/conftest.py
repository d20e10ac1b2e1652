"""Each test of the contract runs with both parts behind the seam: Zenoh itself and the network in memory."""

import pytest

from link.parts import Memory, Zenoh


@pytest.fixture(params=[Memory, Zenoh])
def part(request: pytest.FixtureRequest) -> type:
    return request.param
