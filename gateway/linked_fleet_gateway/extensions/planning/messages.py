"""Messages between the gateway and the process that plans motions. Metre, radian, second; MessagePack."""

from typing import Literal

from msgspec import Struct

from linked_fleet_gateway.extensions.world.messages import Check, CollisionFound, Positions


class JointBounds(Struct, frozen=True):
    """What a joint may do on a path: positions (rad or m), speed and acceleration.

    A continuous joint has positions around its start and its goals.
    """

    lower: float
    upper: float
    speed: float
    acceleration: float


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


class StraightFound(Struct, frozen=True, tag="straight"):
    """A path along a line; the link leaves it by at most ``off_m``, and its orientation by ``off_rad``."""

    joints: tuple[str, ...]
    times_s: tuple[float, ...]
    positions: tuple[tuple[float, ...], ...]
    off_m: float
    off_rad: float


class LineEnds(Struct, frozen=True, tag="ends"):
    """The joints can follow the line up to ``share`` of it: ``at`` in the frame of the root. ``joint`` may be empty."""

    share: float
    why: str
    joint: str
    at: tuple[float, float, float]


class PathFound(Struct, frozen=True, tag="path"):
    """A path that the check has found free: positions of ``joints`` at times after the start.

    ``length`` is that of the path in the space of joints, ``direct`` that of the straight line (rad, m); ``tries`` is
    the number of searches.
    """

    joints: tuple[str, ...]
    times_s: tuple[float, ...]
    positions: tuple[tuple[float, ...], ...]
    length: float
    direct: float
    tries: int


class BlockedAt(Struct, frozen=True, tag="blocked"):
    """The robot touches something where it begins, or would do so at every goal."""

    place: Literal["start", "goal"]
    by: CollisionFound


class NotFound(Struct, frozen=True, tag="none"):
    """No path was found in time. ``by`` is what the straight line meets, if that is known."""

    by: CollisionFound | None = None


class PlanFailed(Struct, frozen=True, tag="unplanned"):
    reason: str


PlanQuestion = FindPath | FindStraight
PlanAnswer = PathFound | StraightFound | LineEnds | BlockedAt | NotFound | PlanFailed
