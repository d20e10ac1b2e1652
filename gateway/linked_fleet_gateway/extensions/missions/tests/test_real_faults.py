"""A mission of ten steps on three robots among real processes that are killed: each step is taken once."""

import contextlib
import signal
from collections import Counter
from collections.abc import Iterator

import pytest
import rdflib

from browser import Browser
from gateway_group import LOOPBACK, Gateway
from mission_fleet import TURNS, MissionFleet, mission_fleet
from redis_servers import Server, cluster_replicated
from running import eventually, process

pytestmark = pytest.mark.test_all
KILLS = 10


@pytest.fixture
def fleet(tmp_path_factory: pytest.TempPathFactory) -> Iterator[MissionFleet]:
    with mission_fleet(tmp_path_factory.mktemp("redis")) as found:
        yield found


@contextlib.contextmanager
def again(fleet: MissionFleet, gone: Gateway) -> Iterator[Gateway]:
    """Start a gateway that was killed."""
    port = gone.browser.root.rstrip("/").rpartition(":")[2]
    shared = ("--zenoh-connect", fleet.hub.endpoint, "--redis-url", fleet.memory.url, "--callback-allow", LOOPBACK)
    with process("-m", "linked_fleet_gateway", "--port", port, *shared) as running:
        running.said("serving")
        with contextlib.closing(Browser(gone.browser.root)) as browser:
            one = Gateway(running, browser)
            one.meet(fleet.hub)
            yield one


def changed(fleet: MissionFleet, path: str, at: Gateway, what: str) -> None:
    """Wait until a run says something else of its steps, as seen at a gateway."""

    def steps() -> set[tuple[rdflib.term.Node, ...]]:
        return {each for each in fleet.described(path, at) if not isinstance(each[2], rdflib.URIRef | rdflib.BNode)}

    before = steps()
    eventually(lambda: steps() != before, what)


def test_each_step_is_taken_once_while_gateways_are_killed_ten_times(fleet: MissionFleet) -> None:
    """The gateway that carries out the run is killed in the middle of its steps, ten times one after the other."""
    path = fleet.begin(times=KILLS)
    driving, waiting = fleet.one, fleet.other
    with contextlib.ExitStack() as stack:
        for _ in range(KILLS):
            eventually(lambda at=waiting: fleet.described(path, at), "the run at the other gateway")  # type: ignore[misc]
            changed(fleet, path, waiting, "a step that begins or ends")
            driving.process.send(signal.SIGKILL)
            waiting.process.said("goes on here")
            driving, waiting = waiting, stack.enter_context(again(fleet, driving))
        fleet.succeeds(path, driving)
        fleet.other = driving
        assert fleet.taken() == Counter({name: KILLS * count for name, count in TURNS.items()})


def test_each_step_is_taken_once_when_masters_of_a_cluster_fail(tmp_path_factory: pytest.TempPathFactory) -> None:
    with mission_fleet(tmp_path_factory.mktemp("cluster"), cluster_replicated) as fleet:
        path = fleet.begin(times=3)
        for node, replica in zip(fleet.memory.nodes, fleet.memory.replicas, strict=True):
            changed(fleet, path, fleet.other, "a step that begins or ends")
            node.kill()
            promoted(replica)
            node.start()
        fleet.succeeds(path)
        assert fleet.taken() == Counter({name: 3 * count for name, count in TURNS.items()})


def promoted(replica: Server) -> None:
    eventually(lambda: "role:master" in replica.ask("INFO replication"), "a replica that becomes the master")
