"""Errors of the collision check.

``Collides`` (409, collision), ``Unchecked`` (503, unchecked).
"""

from collections.abc import Sequence

from linked_fleet_gateway.base.errors import Members, MotionRefused
from linked_fleet_gateway.fleet.xml import Vector


class Collides(MotionRefused):
    """On its way the robot would meet something. ``things``: IRIs of its link and of what that meets, as far as who
    asks may know it, with ``names`` for people; ``share``: of the way that is free; ``point``: where in the world they
    would meet, in metre, if it is known. ``reason`` names nothing but the robot's own."""

    status, code, title = 409, "collision", "The motion would end in a collision"

    def __init__(
        self,
        detail: str,
        *,
        things: Sequence[str] = (),
        names: Sequence[str] = (),
        share: float | None = None,
        point: Vector | None = None,
        reason: str = "",
    ) -> None:
        super().__init__(detail, reason=reason)
        self.things, self.names, self.share, self.point = list(things), list(names), share, point

    def locate(self, base: str) -> None:
        self.things = [base + path for path in self.things]

    @property
    def members(self) -> Members:
        if self.share is None:
            return {}
        place = {} if self.point is None else {"point": list(self.point)}
        return {"things": self.things, "names": self.names, "share": self.share, **place}


class Unchecked(MotionRefused):
    """The check of the motion for collisions could not be made, so nothing moves; ``reason`` as of Collides."""

    status, code, title = 503, "unchecked", "The motion could not be checked"

    def __init__(self, detail: str, *, reason: str = "") -> None:
        super().__init__(detail, reason=reason or "it could not be checked for collisions")
        self.headers["Retry-After"] = "2"
