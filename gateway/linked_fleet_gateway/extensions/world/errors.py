"""Errors of the collision check.

``Collides`` (409, collision), ``Unchecked`` (503, unchecked).
"""

from collections.abc import Sequence

from linked_fleet_gateway.base.errors import Members, MotionRefused
from linked_fleet_gateway.fleet.xml import Vector


class Collides(MotionRefused):
    """The motion would collide.

    ``things`` are IRIs of the robot's link and of the other body, if the caller may know it, with ``names`` for people.
    ``share`` is the free share of the path, ``point`` the place of the collision in the world in metre, if known.
    ``reason`` names only parts of the robot itself.
    """

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
    """The motion could not be checked for collisions, so it is refused; ``reason`` as in Collides."""

    status, code, title = 503, "unchecked", "The motion could not be checked"
    retry_after_s = 2

    def __init__(self, detail: str, *, reason: str = "") -> None:
        super().__init__(detail, reason=reason or "it could not be checked for collisions")
