"""Callbacks while a Redis cluster goes away and comes back."""

import pytest

from cluster.on_cluster import memory
from fleet.test_callback_memory import test_the_memory_goes_away_and_comes_back_under_load
from redis_servers import Servers

pytestmark = [pytest.mark.processes, pytest.mark.test_all]


@pytest.fixture(autouse=True)
def _empty(memory: Servers) -> None:
    """Remove the subscriptions of the test before, because tests of a file share the cluster."""
    memory.empty()
