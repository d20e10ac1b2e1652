"""Guards judge no motion before what they need to know is read."""

from types import SimpleNamespace
from typing import Any, cast

import pytest

from linked_fleet_agent.wire.messages import Move
from linked_fleet_base.errors import NotReadYet
from linked_fleet_gateway.actions.guards import Guards
from linked_fleet_gateway.actions.plan import Caller, Motion, RobotTime
from linked_fleet_gateway.extensions.latches.terms import LF
from linked_fleet_identity.rights import ALL
from linked_fleet_runtime.replica import Copies, Loading
from linked_fleet_state.unchecked import Finding

_MOTION = Motion(cast(Any, SimpleNamespace(name="a")), Move({"j": 1.0}), {}, RobotTime(1, 1))
_CALLER = cast(Caller, SimpleNamespace(visible_robots=ALL))


class _Guard:
    """Finds every path free."""

    finding_predicate = LF.notLatched

    async def wait_until_ready(self, robot: object, visible_robots: object) -> None:
        """Wait for nothing."""

    async def check_path(self, motion: object, visible_robots: object, own_id: str) -> Finding:
        return Finding(free=True)


async def test_motions_are_refused_until_what_they_are_judged_by_is_read() -> None:
    copies, objects, notes = Copies(), Loading(), Loading()
    copies.add("objects", objects, needed_by_motions=True)
    copies.add("notes", notes)
    guards = Guards(copies)
    guards.add(_Guard())
    with pytest.raises(NotReadYet, match="objects"):
        await guards.wait_until_ready(_MOTION.robot, ALL)
    with pytest.raises(NotReadYet, match="objects"):
        await guards.findings(_MOTION, _CALLER, "")
    with objects.loading():
        pass
    await guards.wait_until_ready(_MOTION.robot, ALL)
    assert (await guards.findings(_MOTION, _CALLER, ""))[LF.notLatched].free
