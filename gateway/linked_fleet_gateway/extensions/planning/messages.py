"""Messages between the gateway and the process that plans motions. Metre, radian, second; MessagePack."""

from typing import Literal

from msgspec import Struct

from linked_fleet_gateway.extensions.world.messages import Check, CollisionFound, Positions
from linked_fleet_state.xml import Vector


class JointBounds(Struct, frozen=True):
    """The limits of a joint on a path: positions (rad or m), speed and acceleration.

    A continuous joint has positions around its start and its goals.
    """

    lower: float
    upper: float
    speed: float
    acceleration: float


class Constraints(Struct, frozen=True):
    """Constraints of the link ``tip`` on a path; empty if no single link is meant. Radian, metre, metre per second.

    ``axis`` is its axis that points up, for ``upright``; empty for that which is nearest to the vertical at the start.
    ``stay_in`` has the least and the largest coordinates of its origin in the world.
    """

    tip: str = ""
    upright: float | None = None
    axis: str = ""
    stay_in: tuple[Vector, Vector] | None = None
    tip_speed: float | None = None
    least_manipulability: float = 0.0

    @property
    def shape_the_path(self) -> bool:
        """True if not every free path keeps to them."""
        return self.upright is not None or self.stay_in is not None or self.least_manipulability > 0.0


class FindPath(Struct, frozen=True, tag="find"):
    """Find a path of the joints with ``bounds`` to one of the ``goals``, which each names them all.

    ``around`` is a question about a motion: its first path has the start. The answer takes at most ``within_s``
    seconds. ``seed`` is that of the random numbers.
    """

    around: Check
    bounds: dict[str, JointBounds]
    goals: tuple[Positions, ...]
    within_s: float
    seed: int = 0
    keeps: Constraints = Constraints()


class FindStraight(Struct, frozen=True, tag="line"):
    """Find a path of the joints with ``bounds`` that brings a link to a target along a straight line.

    ``around`` is as for ``FindPath``. The line ends where the link is at the ``goal`` of the joints. The orientation
    ``turns`` evenly to that there, or stays. If ``exact``, the joints have to end at their goals.
    """

    around: Check
    bounds: dict[str, JointBounds]
    link: str
    goal: Positions
    turns: bool
    exact: bool
    keeps: Constraints = Constraints()


class LeastManipulability(Struct, frozen=True):
    """The least manipulability of the tip along a path, and when."""

    value: float
    at_s: float


class Broken(Struct, frozen=True, tag="broken"):
    """A constraint that is not kept to after ``share`` of the path, or of every path at its start or goal.

    ``value`` is what would be (rad, m or a manipulability), ``limit`` what may. ``axis`` is that of the world, for a
    box, or that of the tip.
    """

    kind: Literal["upright", "stayIn", "leastManipulability"]
    share: float
    value: float
    limit: float
    axis: str = ""


class StraightFound(Struct, frozen=True, tag="straight"):
    """A path along a line; the link leaves it by at most ``off_m``, and its orientation by ``off_rad``."""

    joints: tuple[str, ...]
    times_s: tuple[float, ...]
    positions: tuple[tuple[float, ...], ...]
    off_m: float
    off_rad: float
    least: LeastManipulability | None = None


class LineEnds(Struct, frozen=True, tag="ends"):
    """The joints can follow the line up to ``share`` of it: ``at`` in the frame of the root. ``joint`` may be empty."""

    share: float
    why: str
    joint: str
    at: tuple[float, float, float]


class PathFound(Struct, frozen=True, tag="path"):
    """A path that the check has found free: positions of ``joints`` at times after the start.

    ``length`` is that of the path in the space of joints, ``direct`` that of the straight line (rad, m); ``tries`` is
    the number of searches. ``near`` is what is nearest to the robot at its start, if it is within the margin.
    """

    joints: tuple[str, ...]
    times_s: tuple[float, ...]
    positions: tuple[tuple[float, ...], ...]
    length: float
    direct: float
    tries: int
    least: LeastManipulability | None = None
    near: CollisionFound | None = None


class BlockedAt(Struct, frozen=True, tag="blocked"):
    """The robot would touch something at every goal, or no path was found and something is near where it begins."""

    place: Literal["start", "goal"]
    by: CollisionFound


class NotFound(Struct, frozen=True, tag="none"):
    """No path was found in time."""


class PlanFailed(Struct, frozen=True, tag="unplanned"):
    reason: str


PlanQuestion = FindPath | FindStraight
PlanAnswer = PathFound | StraightFound | LineEnds | BlockedAt | Broken | NotFound | PlanFailed
