"""Streams that move from one gateway to another, on a Redis cluster."""

import pytest

from cluster import on_cluster
from fleet.test_stream_handover import *

# It replaces a method of the gateways, which are other processes here.
del test_a_stream_that_is_deleted_while_another_gateway_opens_it_stays_deleted  # noqa: F821 - imported above

pytestmark = [pytest.mark.processes, pytest.mark.test_all]
memory = on_cluster.memory  # after all imports, because it replaces the fixture of that module
