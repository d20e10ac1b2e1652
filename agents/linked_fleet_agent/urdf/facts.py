"""The facts about joints that drivers need."""

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

from linked_fleet_agent.urdf.joints import JointKind
from linked_fleet_agent.urdf.limits import NO_LIMITS, Limits, Range
from linked_fleet_agent.urdf.model import RobotModel

# If all seven joints of an arm of 1.2 m are off by this much in the same direction, its tip is off by less than 1 mm.
TOLERANCE_RAD, TOLERANCE_M = 2e-4, 2e-4


@dataclass(frozen=True)
class JointFacts:
    """One movable joint of one degree of freedom; ``mimics`` names the joint that it follows, if any.

    A ``continuous`` joint turns endlessly: positions a whole turn apart are equal. A ``passive`` joint is measured but
    takes no commands. ``refusal`` says why the description does not let the joint be moved; empty if it does. ``stops``
    is the range that it can reach, also beyond the limits of commands. A motion succeeds when the joint stands within
    ``tolerance`` (rad or m) of its target. ``resolution`` is the smallest change that its sensor shows; a tolerance
    follows from it where a driver declares no other one (``arrival_tolerance``). Where it declares neither, the agent
    takes the smallest change that it has seen.
    """

    name: str
    linear: bool = False
    limits: Limits = NO_LIMITS
    mimics: str | None = None
    continuous: bool = False
    passive: bool = False
    refusal: str = ""
    stops: Range = (None, None)
    tolerance: float | None = None
    resolution: float | None = None

    @property
    def unit(self) -> str:
        """The unit of positions: m or rad."""
        return "m" if self.linear else "rad"

    @property
    def arrival_tolerance(self) -> float | None:
        """Return how near to its target a motion brings the joint, as far as its driver says so; else None.

        A known resolution counts whole: a servo rounds the target by half of it, and an encoder the position.
        """
        if self.tolerance is not None or self.resolution is None:
            return self.tolerance
        return max(self.resolution, TOLERANCE_M if self.linear else TOLERANCE_RAD)

    def difference(self, position: float, other: float) -> float:
        """Return ``position`` minus ``other``; for a continuous joint the nearest of the equal ways, from -π to π."""
        way = position - other
        return math.remainder(way, math.tau) if self.continuous and math.isfinite(way) else way


def joint_mismatch(model: RobotModel, names: Sequence[str]) -> str:
    """Return how the joints that an agent measures contradict its description; empty if they do not."""
    repeated = next((name for name, count in Counter(names).items() if count > 1), None)
    if repeated is not None:
        return f"the description lists joint {repeated[:128]!r} twice"
    for name in names:
        joint = model.joints.get(name)
        if joint is None or not joint.movable:
            return f"the description lists joint {name[:128]!r}, which its URDF does not have as a movable joint"
    return ""


def joints_of(urdf: str) -> tuple[JointFacts, ...]:
    """Return all joints of one degree of freedom in document order, mimic joints included.

    Raises UrdfError if the text is not the description of one robot.
    """
    return tuple(
        JointFacts(
            name=joint.name,
            linear=joint.kind is JointKind.PRISMATIC,
            limits=joint.limits,
            mimics=None if joint.mimic is None else joint.mimic.joint,
            continuous=joint.kind is JointKind.CONTINUOUS,
            passive=bool(joint.refusal),
            refusal=joint.refusal or joint.unranged,
            stops=joint.stops,
        )
        for joint in RobotModel.for_urdf(urdf).joints.values()
        if joint.movable
    )
