"""Callbacks at two gateways whose memory is a cluster."""

import pytest
from cluster.on_cluster import memory
from fleet.test_callbacks import *

pytestmark = pytest.mark.test_all
