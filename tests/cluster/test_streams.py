"""The tests of ``tests/gateway/subscriptions/test_streams.py`` with a store on a cluster."""

from collections.abc import Iterator

import pytest

from redis_servers import Servers, cluster
from tests.gateway.subscriptions.test_streams import *

pytestmark = [pytest.mark.processes, pytest.mark.test_all]


@pytest.fixture(scope="module")  # type: ignore[no-redef]
def servers(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Servers]:
    with cluster(tmp_path_factory.mktemp("redis")) as running:
        yield running
