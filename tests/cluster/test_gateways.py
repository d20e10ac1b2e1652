"""Gateways on a Redis cluster: robots and subscriptions live on different nodes, and each gateway knows all of them."""

import contextlib
from collections.abc import Iterator
from pathlib import Path

import httpx
import pytest

from browser import DCTERMS, LF
from commanding import (
    PREFIXES,
    WRIST,
    all_see,
    at_all,
    begun,
    control,
    invocations,
    of_joint,
    problem,
    put,
    radian,
    state_at,
)
from gateway_group import Gateway, Hub, arrived, deliveries, gateway, gateways, hub
from receivers import receiving
from redis_servers import Servers, cluster
from running import eventually, process

pytestmark = [pytest.mark.processes, pytest.mark.test_all]
NAMES = ("ada", "bob", "cleo", "dan")


@pytest.fixture
def engine(tmp_path: Path) -> Iterator[Servers]:
    with cluster(tmp_path) as servers:
        yield servers


@contextlib.contextmanager
def arms(endpoint: str) -> Iterator[None]:
    with process("-m", "linked_fleet_agent", *(f"--robot={name}=ur5" for name in NAMES), "--connect", endpoint):
        yield


def prepare(gateway: Gateway, name: str) -> str:
    """Set a robot's title, rotate it, and take its control lease; return the invocation."""
    robot = gateway.browser.robot(name)
    title = put(gateway.browser, str(robot.property(LF.TextProperty)), PREFIXES + f'<> lf:value "Arm of {name}" .')
    assert title.status_code == 204, title.text
    motion = begun(put(gateway.browser, of_joint(gateway.browser, WRIST, robot=name), radian(0.2), prefer="wait=30"))
    taken = put(gateway.browser, str(robot.one(LF.lease)), control(name, 600))
    assert taken.status_code == 204, taken.text
    return httpx.URL(motion).path


def knows(gateway: Gateway, motions: dict[str, str], callbacks: set[str]) -> None:
    for name, motion in motions.items():
        robot = gateway.browser.robot(name)
        assert str(robot.graph.value(robot.iri, DCTERMS.title)) == f"Arm of {name}"
        lease = gateway.browser.page(str(robot.one(LF.lease)))
        assert str(lease.graph.value(lease.iri, LF.holder)) == name
        action = of_joint(gateway.browser, WRIST, robot=name)
        assert invocations(gateway.browser, action) == [motion]
        assert state_at(gateway, motion) == LF.succeeded
        assert problem(put(gateway.browser, action, radian(0.0))) == (409, "controlled")
    assert gateway.listed() == callbacks


def test_each_gateway_knows_what_the_others_do_whichever_node_has_it(stage: Hub, engine: Servers) -> None:
    """Also after each node was killed and restarted, and at a gateway that starts later."""
    with receiving() as receiver, arms(stage.endpoint), gateways(stage, engine.url) as two:
        for name in NAMES:
            all_see(two, name)
        motions = {name: prepare(two[index % 2], name) for index, name in enumerate(NAMES)}
        paths = [f"/{index}" for index in range(4)]
        made = [two[index % 2].subscribed(receiver.url(path)) for index, path in enumerate(paths)]
        callbacks = {httpx.URL(iri).path for iri in made}
        at_all(two, lambda each: all(state_at(each, motion) == LF.succeeded for motion in motions.values()), "motions")
        for each in two:
            eventually(lambda each=each: controlled(each), "control")
            knows(each, motions, callbacks)
        for node in engine.nodes:
            node.kill()
            stage.step()
            node.start()
            eventually(lambda: all("cluster_state:ok" in one.ask("CLUSTER INFO") for one in engine.nodes), "a cluster")
            for path in paths:
                arrived(receiver, path, stage.angle)
            at_all(two, lambda each: each.get(each.container).status_code == 200, "Redis")
        with gateway(stage, "--redis-url", engine.url) as third:
            for each in (*two, third):
                for name in NAMES:
                    all_see([each], name)
                eventually(lambda each=each: controlled(each), "control")
                knows(each, motions, callbacks)
        for path in paths:
            deliveries(receiver.log(path))


def controlled(gateway: Gateway) -> bool:
    """Return True if it knows all leases."""
    leases = [gateway.browser.page(str(gateway.browser.robot(name).one(LF.lease))) for name in NAMES]
    return all((page.iri, LF.holder, None) in page.graph for page in leases)
