"""The wall clock of Redis's machine jumps by an hour: decisions of gateways do not depend on it."""

import signal
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from browser import LF
from commanding import (
    PAN,
    WRIST,
    all_see,
    angle,
    arm,
    at_all,
    begun,
    control,
    ended,
    moving,
    of_joint,
    problem,
    put,
    radian,
    slowly,
    state_at,
)
from gateway_group import Gateway, arrived, deliveries, gateway, hub
from receivers import receiving
from redis_servers import Server, single
from running import eventually
from subscribers import Socket

pytestmark = pytest.mark.virtual
HOUR_S = 3600


def _wall_s(node: Server) -> float:
    return float(node.ask("EVAL", '"return redis.call([[TIME]])[1]"', 0))


def _lease(at: Gateway) -> str:
    return str(at.browser.robot("ur5").one(LF.lease))


def _held(at: Gateway) -> bool:
    return at.browser.page(_lease(at)).one(LF.state) == LF.held


@pytest.mark.parametrize("jump_s", [HOUR_S, -HOUR_S])
def test_the_clock_of_redis_jumps(tmp_path: Path, jump_s: int) -> None:
    with single(tmp_path) as memory:
        node: Any = memory.nodes[0]
        all_goes_on(node, jump_s, node.step_wall)


def all_goes_on(node: Server, jump_s: int, jump: Callable[[int], None]) -> None:
    """Check that motion, control, stream and callback continue, and leases end on time.

    This includes leases and callbacks of a gateway that is killed afterwards.
    """
    with (
        hub() as stage,
        receiving() as receiver,
        arm(stage.endpoint),
        gateway(stage, "--redis-url", node.url) as other,
        gateway(stage, "--redis-url", node.url) as at,
    ):
        all_see([at, other])
        at.subscribed(receiver.url("/kept"))
        taken = put(at.browser, _lease(at), control("me", 20))
        proof, key = {"lock-token": taken.headers["lock-token"]}, {"idempotency-key": "once"}
        present = angle(at.browser, PAN)
        body = slowly(present + (-1.0 if present > 0 else 1.0), f"; lf:tiedTo <{_lease(at)}>", speed=0.2)
        motion = begun(put(at.browser, of_joint(at.browser, PAN), body, **proof, **key))
        moving(at.browser, PAN)
        with Socket(at.rotation) as watching:
            watching.next()
            before_s = _wall_s(node)
            jump(jump_s)
            eventually(lambda: abs(_wall_s(node) - before_s - jump_s) < 600, "the other time")
            for _ in range(20):
                stage.step()
                assert watching.next().angle == stage.angle
            for each in (at, other):
                assert _held(each)
                refused = put(each.browser, of_joint(each.browser, WRIST), radian(0.5))
                assert problem(refused) == (409, "controlled")
            assert begun(put(at.browser, of_joint(at.browser, PAN), body, **proof, **key)) == motion
            assert ended(other.browser, other.here(motion)).one(LF.state) == LF.succeeded
            assert len(at.listed()) == 2
        arrived(receiver, "/kept", stage.angle)
        at_all([at, other], lambda each: not _held(each), "the end of the lease")
        again = put(other.browser, _lease(other), control("you", 600))
        assert again.status_code == 204
        assert not [each for each in (at, other) if "subscriptions over from" in each.process.output]
        at.process.send(signal.SIGKILL)
        stage.step()
        arrived(receiver, "/kept", stage.angle)
        deliveries(receiver.log("/kept", "POST"))
        assert eventually(lambda: state_at(other, motion) == LF.succeeded, "the invocation")
        assert "Traceback" not in other.process.output
