"""Streams that go from one gateway to another whose memory is a cluster."""

import pytest
from cluster.on_cluster import memory
from fleet.test_stream_handover import *

pytestmark = pytest.mark.test_all
