"""Fixtures of tests with several gateways. Files whose tests share a hub or a Redis server define their own."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from commanding import all_see, arm
from gateway_group import Gateway, Hub, gateways, hub, two_with_an_arm
from receivers import Receiver, receiving
from redis_servers import Servers, single


@pytest.fixture
def stage() -> Iterator[Hub]:
    with hub() as stage:
        yield stage


@pytest.fixture
def memory(tmp_path: Path) -> Iterator[Servers]:
    with single(tmp_path / "redis") as servers:
        yield servers


@pytest.fixture
def receiver() -> Iterator[Receiver]:
    with receiving() as receiver:
        yield receiver


@pytest.fixture(scope="module")
def two(_virtual: None, tmp_path_factory: pytest.TempPathFactory) -> Iterator[list[Gateway]]:
    """Run two gateways with one Redis server and a UR5 that both of them see."""
    folder = tmp_path_factory.mktemp("redis")
    with hub() as stage, single(folder) as memory, arm(stage.endpoint), gateways(stage, memory.url) as found:
        all_see(found)
        yield found
        assert not [each.process.output for each in found if "Traceback" in each.process.output]


@pytest.fixture
def two_and_store(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Servers, Gateway, Gateway]]:
    """Run a store, and two gateways that share it and see the robot ``ur5``."""
    with two_with_an_arm(tmp_path_factory.mktemp("redis")) as found:
        yield found
