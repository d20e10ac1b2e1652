"""Refusals of motions for which no path is found."""

from collections.abc import Sequence

from linked_fleet_base.errors import Members, MotionRefused
from linked_fleet_gateway.extensions.planning.messages import Broken
from linked_fleet_gateway.extensions.planning.terms import LF
from linked_fleet_gateway.extensions.world.collisions import Collides
from linked_fleet_state.xml import Vector


class _InTheWay(MotionRefused):
    """Something is in the way: ``things``, IRIs of the link of the robot and of the other body, with ``names``."""

    status = 409

    def __init__(self, detail: str, *, reason: str, met: Collides | None = None) -> None:
        super().__init__(detail, reason=reason)
        self.things: Sequence[str] = () if met is None else met.things
        self.names: Sequence[str] = () if met is None else met.names
        self.point: Vector | None = None if met is None else met.point

    def locate(self, base: str) -> None:
        self.things = [base + path for path in self.things]

    @property
    def members(self) -> Members:
        place = {} if self.point is None else {"point": list(self.point)}
        return {"things": list(self.things), "names": list(self.names), **place} if self.things else {}


class GoalBlocked(_InTheWay):
    """The robot would touch something where the motion ends."""

    code, title = "goal-blocked", "Something is where the motion would end"


class StartBlocked(_InTheWay):
    """No path was found, and something is so near where the motion begins that it may be what is in the way."""

    code, title = "start-blocked", "Something is where the motion would begin"


class NoPathFound(_InTheWay):
    """No path was found in the time for the search; there may be one. ``things`` are in the way of the direct path."""

    code, title = "no-path-found", "No path was found in time"


class PlanChanged(_InTheWay):
    """A plan that was kept cannot be carried out as it was rehearsed: the robot, what is around or the request differs.

    ``things`` are what would meet, if something is in the way.
    """

    code, title = "changed", "The plan is not what it was rehearsed for"


class BreaksConstraint(MotionRefused):
    """The motion does not keep to a constraint after a ``share`` of its path; at its start or goal, no path does.

    ``value`` is what would be there (rad, m or a manipulability), ``limit`` what may.
    """

    status, code, title = 409, "breaks-constraint", "The motion does not keep to a constraint"

    def __init__(self, detail: str, *, reason: str, broken: Broken | None = None) -> None:
        super().__init__(detail, reason=reason)
        self._broken = broken

    @property
    def members(self) -> Members:
        if (broken := self._broken) is None:
            return {}
        kind = str(LF.terms[broken.kind].value)
        return {"broken": kind, "share": broken.share, "value": round(broken.value, 5), "limit": broken.limit}


class LineLeaves(MotionRefused):
    """The joints can follow a straight line up to a ``share`` of it only, which is at ``point`` in the world."""

    status, code, title = 409, "line-ends", "The straight line leaves what the joints can do"

    def __init__(self, detail: str, *, reason: str, share: float | None = None, point: Vector | None = None) -> None:
        super().__init__(detail, reason=reason)
        self.share, self.point = share, point

    @property
    def members(self) -> Members:
        if self.share is None or self.point is None:
            return {}
        return {"share": self.share, "point": [round(each, 4) for each in self.point]}
