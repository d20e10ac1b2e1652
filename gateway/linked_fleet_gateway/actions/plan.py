"""Plans, which handlers make of admitted bodies: a motion, a halt, or one of them later. Nothing has happened yet."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from linked_fleet_agent.wire.messages import Expectation, Follow, Move
from linked_fleet_gateway.fleet.robot import Robot


@dataclass(frozen=True)
class Moment:
    """When something was asked for, by the robot's own clock: its run, and the monotonic time of its latest frame.

    Whatever is waited for after that (a search, Redis, a turn), the command is of that moment, and too late if it took
    too long or the robot was stopped meanwhile. What it waited to be
    checked for collisions does not make it late.
    """

    incarnation: int
    seen_ns: int
    waited_ns: int = 0


@dataclass(frozen=True)
class Motion:
    """``targets``: where the joints end (rad or m). ``scale``: share of the robot's speed; ``expects``: where joints
    must be at the start. ``tied``: stop when the lease ends. ``facts``: what else is worth telling, by name (SI)."""

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
    """Stop robots: all that there are for None; ``joints``: these alone."""

    robots: tuple[str, ...] | None
    joints: tuple[str, ...] = ()


@dataclass(frozen=True)
class Later:
    """A plan that takes milliseconds to make. ``compute`` runs in a thread and looks at nothing that changes."""

    compute: Callable[[], Motion]


Plan = Motion | Halt | Later
