"""The limit of unfinished motions per client over all gateways, and what it must never prevent."""

from pathlib import Path

import pytest

from browser import HYBRIT, LF
from commanding import (
    LIFT,
    PAN,
    WRIST,
    all_see,
    angle,
    arm,
    begun,
    ended,
    moving,
    of_joint,
    of_robot,
    post,
    problem,
    put,
    radian,
    slowly,
    state_at,
)
from gateway_group import Gateway, gateway, hub
from redis_servers import single
from running import eventually

pytestmark = pytest.mark.virtual
_PLANS = [{}, {"prefer": "dry-run"}, {"idempotency-key": "new"}]


def _begin(at: Gateway, joint: str, **fields: str) -> str:
    """Begin a motion of many seconds."""
    here = angle(at.browser, joint)
    return begun(put(at.browser, of_joint(at.browser, joint), slowly(here - 2 if here > 0 else here + 2), **fields))


def test_a_client_at_its_limit_of_motions_is_refused_until_some_end(tmp_path: Path) -> None:
    """At any gateway; a repeated request gets its former response, and stops are never refused."""
    with hub() as stage, single(tmp_path) as memory, arm(stage.endpoint):
        flags = ("--redis-url", memory.url, "--invocations-per-client=2")
        with gateway(stage, *flags) as one, gateway(stage, *flags) as other:
            all_see([one, other])
            body, once = slowly(1.0), {"idempotency-key": "once"}
            first = begun(put(one.browser, of_joint(one.browser, PAN), body, **once))
            second = _begin(one, LIFT)
            eventually(lambda: state_at(other, second) == LF.running, "the motion at the other gateway")
            wrist = angle(one.browser, WRIST)
            for each in (one, other):
                for fields in _PLANS:
                    answer = put(each.browser, of_joint(each.browser, WRIST), radian(wrist + 0.3), **fields)
                    assert problem(answer) == (429, "too-many-invocations")
                    assert answer.headers["retry-after"] and "cancel" in answer.json()["detail"]
            repeated = begun(put(one.browser, of_joint(one.browser, PAN), body, **once))
            assert repeated == first
            assert post(other.browser, of_joint(other.browser, WRIST, LF.Hold)).status_code == 204
            cancel = str(other.browser.page(other.here(second)).one(HYBRIT.action))
            assert post(other.browser, cancel).status_code == 204
            assert ended(one.browser, second).one(LF.state) == LF.cancelled
            _begin(one, WRIST, **{"idempotency-key": "new"})  # the refusal has not used up the key
            moving(one.browser, WRIST)
            for each in (one, other):
                assert post(each.browser, of_robot(each.browser, LF.StopRobot)).status_code == 204
            assert ended(one.browser, first).one(LF.state) == LF.cancelled
