"""Streams that go from one gateway to another whose memory is a cluster."""

import pytest

from cluster import on_cluster
from fleet.test_stream_handover import *

pytestmark = pytest.mark.test_all
memory = on_cluster.memory  # after the import of all, which brings the one of that file
