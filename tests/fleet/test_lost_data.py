"""An external Redis that is emptied while gateways run: every gateway says so, and goes on."""

import time
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest

from browser import LF
from commanding import WRIST, angle, arm, begun, ended, of_joint, put, radian
from gateway_group import Gateway, gateways, hub
from linked_fleet_runtime.store_marker import CHECK_S, LOSS
from redis_servers import Servers, single
from running import eventually
from small_fleet import live

pytestmark = pytest.mark.virtual


@pytest.fixture
def both(tmp_path: Path) -> Iterator[tuple[Servers, list[Gateway]]]:
    with ExitStack() as stack:
        stage, memory = stack.enter_context(hub()), stack.enter_context(single(tmp_path))
        stack.enter_context(arm(stage.endpoint))
        found = stack.enter_context(gateways(stage, memory.url))
        for each in found:
            live(each.browser, "ur5")
        time.sleep(2 * CHECK_S)
        yield memory, found
        for each in found:
            assert "Traceback" not in each.process.output, each.process.output


def _warnings(gateway: Gateway) -> list[str]:
    found: list[str] = gateway.get(f"{gateway.browser.root}health/ready").json().get("warnings", [])
    return found


def test_an_emptied_redis_is_reported_once_by_every_gateway(both: tuple[Servers, list[Gateway]]) -> None:
    memory, found = both
    assert [_warnings(each) for each in found] == [[], []]
    assert memory.nodes[0].ask("FLUSHALL") == "+OK"
    for each in found:
        eventually(lambda each=each: _warnings(each) == [LOSS], "the warning")
        page = each.browser.http.get(each.browser.root, headers={"accept": "text/html"})
        assert LOSS.partition(":")[0] in page.text
    time.sleep(4 * CHECK_S)
    for each in found:
        assert each.process.output.count(LOSS) == 1
        motion = begun(put(each.browser, of_joint(each.browser, WRIST), radian(angle(each.browser, WRIST) + 0.1)))
        assert ended(each.browser, motion).one(LF.state) == LF.succeeded


def test_an_outage_is_no_loss(both: tuple[Servers, list[Gateway]]) -> None:
    memory, found = both
    (node,) = memory.nodes
    node.kill()
    time.sleep(3 * CHECK_S)
    node.start()
    time.sleep(3 * CHECK_S)
    for each in found:
        assert _warnings(each) == [] and LOSS not in each.process.output
