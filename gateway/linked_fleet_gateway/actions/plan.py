"""Plans: a motion, a halt, or a computation of a motion. Plans have no side effects."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from linked_fleet_agent.wire.messages import Expectation, Follow, Move
from linked_fleet_gateway.fleet.robot import Robot


@dataclass(frozen=True)
class Moment:
    """The time of a request by the robot's own clock: its run, and the monotonic time of its latest frame.

    The command keeps this time whatever delays follow (a search, Redis, a turn), so it is refused as stale after too
    long or after a stop. ``waited_ns`` is the time spent in collision checks, which does not count.
    """

    incarnation: int
    seen_ns: int
    waited_ns: int = 0


@dataclass(frozen=True)
class Motion:
    """A planned motion.

    ``targets`` are the final positions (rad or m), ``scale`` the share of the robot's speed, ``expects`` required
    positions at the start. A ``tied`` motion stops when the lease ends. ``facts`` are further values to report, by name
    (SI).
    """

    robot: Robot
    motion: Move | Follow
    targets: Mapping[str, float]
    asked: "Moment"
    scale: float = 1.0
    expects: Mapping[str, Expectation] = field(default_factory=dict)
    tied: bool = False
    facts: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class Halt:
    """A stop of robots (all for None), or only of ``joints``."""

    robots: tuple[str, ...] | None
    joints: tuple[str, ...] = ()


@dataclass(frozen=True)
class Later:
    """A plan that takes milliseconds to compute. ``compute`` runs in a thread and uses immutable data only."""

    compute: Callable[[], Motion]


Plan = Motion | Halt | Later
