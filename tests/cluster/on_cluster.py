"""Tests of the folder ``fleet`` with real gateways on a Redis cluster of three masters."""

from collections.abc import Iterator

import pytest

from redis_servers import Servers, cluster


@pytest.fixture(scope="module")
def memory(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Servers]:
    with cluster(tmp_path_factory.mktemp("redis")) as servers:
        yield servers
