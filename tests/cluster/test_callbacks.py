"""Callbacks at two gateways on a Redis cluster."""

import pytest

from cluster import on_cluster
from fleet.test_callbacks import *

pytestmark = [pytest.mark.processes, pytest.mark.test_all]
memory = on_cluster.memory  # after all imports, because it replaces the fixture of that module
