"""Callbacks while a Redis cluster goes away and comes back."""

import pytest

from cluster.on_cluster import memory
from fleet.test_callback_memory import test_the_memory_goes_away_and_comes_back_under_load

pytestmark = [pytest.mark.processes, pytest.mark.test_all]
