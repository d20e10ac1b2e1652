"""Gateways on a Redis cluster that end regularly."""

import pytest

from cluster.on_cluster import memory
from fleet.test_rolling_restart import test_a_rolling_restart_under_load_loses_nothing

pytestmark = [pytest.mark.processes, pytest.mark.test_all]
