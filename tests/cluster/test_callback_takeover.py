"""A killed gateway on a Redis cluster loses no callback."""

import pytest

from cluster.on_cluster import memory
from fleet.test_callback_takeover import test_a_gateway_killed_among_many_changes_loses_nothing

pytestmark = [pytest.mark.processes, pytest.mark.test_all]
