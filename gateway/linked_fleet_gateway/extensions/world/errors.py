"""Errors of the collision check.

``Collides`` (409, collision), ``Unchecked`` (503, unchecked).
"""

from collections.abc import Sequence

from linked_fleet_gateway.base.errors import Members, MotionRefused


class Collides(MotionRefused):
    """On its way the robot would meet something. ``things``: IRIs of its link and of what that meets, as far as who
    asks may know it; ``share``: of the way that is free. ``reason`` names nothing but the robot's own."""

    status, code, title = 409, "collision", "The motion would end in a collision"

    def __init__(
        self, detail: str, *, things: Sequence[str] = (), share: float | None = None, reason: str = ""
    ) -> None:
        super().__init__(detail, reason=reason)
        self.things, self.share = list(things), share

    def locate(self, base: str) -> None:
        self.things = [base + path for path in self.things]

    @property
    def members(self) -> Members:
        return {} if self.share is None else {"things": self.things, "share": self.share}


class Unchecked(MotionRefused):
    """The check of the motion for collisions could not be made, so nothing moves; ``reason`` as of Collides."""

    status, code, title = 503, "unchecked", "The motion could not be checked"

    def __init__(self, detail: str, *, reason: str = "") -> None:
        super().__init__(detail, reason=reason or "it could not be checked for collisions")
        self.headers["Retry-After"] = "2"
