"""Changes of resources, and their versions (docs/TREE.md, "What counts as change").

The version of a robot's resource is the robot's incarnation and the frame that brought the change, counted from 1.
Changes without a frame (presence, a description) are counted after the frame before them, and changes of values that
come in other messages by themselves. The version of other resources is a digest of their facts. A gateway that starts
watching later may name a later frame for the same value, so versions can only be compared for equality.
"""

from collections.abc import Callable
from hashlib import blake2b
from typing import Any

from msgspec import Struct

from linked_fleet_state.observation import Observation, differ
from linked_fleet_state.robot import Robot


class Reading(Struct):
    """The state of a resource at a moment: ``facts`` are compared as a whole, ``observations`` by value. Immutable."""

    facts: Any
    observations: tuple[Observation, ...] = ()
    version: str = ""

    def equals(self, other: "Reading", deadband: float = 0.0) -> bool:
        """Return True if nothing changed except values within ``deadband``; a new timestamp alone is no change."""
        if self.facts != other.facts or len(self.observations) != len(other.observations):
            return False
        for ours, theirs in zip(self.observations, other.observations, strict=True):
            if ours is theirs:
                continue
            if ours.mark != theirs.mark or differ(ours.values, theirs.values, deadband):
                return False
        return True


class Source(Struct, frozen=True):
    """The source of readings of a resource. ``robot`` is its owner; None if it belongs to no single robot.

    Whoever changes what ``facts`` returns tells the fan-out of it, since they are not read after each frame.
    """

    facts: Callable[[], Any] = tuple
    sample: Callable[[], tuple[Observation, ...]] = tuple
    robot: Robot | None = None
    shared_facts: Callable[[], Any] | None = None
    """The facts that are equal on all gateways, if that is not true of ``facts``."""
    shown: Callable[[], Any] | None = None
    """All that its description depends on, if it belongs to no robot and that is read quickly.

    ``tuple`` says that it never changes.
    """
    counter: Callable[[], int] | None = None
    """Counts the changes of what ``sample`` returns, if no frame causes them."""
    is_final: Callable[[], bool] = bool
    """Returns True if the resource will never change again."""

    def read(self, values: bool = True, previous: Reading | None = None) -> Reading:
        """Return the present reading; without ``values`` only its facts.

        ``previous`` is the latest reading if only a frame has come since. Its facts hold: a frame changes none but the
        time at which an offline robot was last seen.
        """
        robot = self.robot
        facts = previous.facts if previous is not None and robot is not None and robot.online else self.facts()
        observations = self.sample() if values else ()
        if robot is not None:
            incarnation, frame, change = version_of(robot, () if self.counter else observations)
            version = f"{incarnation}-{frame}" + (f".{change}" if change else "")
            version += f"v{self.counter()}" if self.counter and values else ""
            return Reading(facts, observations, version)
        known = facts if self.shared_facts is None else self.shared_facts()
        return Reading(facts, (), blake2b(repr(known).encode(), digest_size=8).hexdigest())

    @property
    def is_measured(self) -> bool:
        """True if frames can change it."""
        return self.sample is not tuple and self.counter is None


def version_of(robot: Robot, observations: tuple[Observation, ...]) -> tuple[int, int, int]:
    """Return the version: incarnation, frame counted from 1, and number of later changes without a frame."""
    frame, change = robot.news
    for seen in observations:
        if seen.sequence is not None and seen.sequence >= frame:
            frame, change = seen.sequence + 1, 0
    return robot.incarnation or 0, frame, change
