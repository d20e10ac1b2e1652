"""Summaries of the faults of each robot, for the list of robots.

Queries do not have them, because they have the faults themselves.
"""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field

from pyoxigraph import Literal, NamedNode

from linked_fleet_base.contributions import present
from linked_fleet_gateway.api import Robot, integer
from linked_fleet_gateway.extensions.faults.fault import SEVERITIES, Fault, Severity
from linked_fleet_gateway.extensions.faults.terms import LF

_SHOWN = ("confirmed", "acknowledged")


@dataclass(frozen=True)
class Summary:
    """Number of open faults of a robot, and severity and title of the worst."""

    count: int
    severity: Severity
    says: str


@dataclass
class FaultsOfRobots:
    """The open faults about one robot alone, of which whoever sees the robot may know. Kept for one gateway."""

    by_robot: Mapping[str, Summary] = field(default_factory=dict)

    def renew(self, faults: Iterable[Fault]) -> bool:
        """Summarize these faults. Return True if that changes anything."""
        found: dict[str, list[Fault]] = {}
        for each in faults:
            if each.state in _SHOWN and len(each.trouble.robots) == 1:
                found.setdefault(each.trouble.robots[0], []).append(each)
        fresh = {robot: _summary(each) for robot, each in found.items()}
        changed, self.by_robot = fresh != self.by_robot, fresh
        return changed


def faults_of_robots() -> FaultsOfRobots:
    """Return the summaries of this gateway."""
    return present().derived("faults of robots", FaultsOfRobots)


def introduction(robot: Robot) -> Iterator[tuple[NamedNode, Literal]]:
    """Yield how many faults a robot has, and what the worst is, for the list of robots."""
    found = faults_of_robots().by_robot.get(robot.name)
    if found is not None:
        yield LF.openFaults, integer(found.count)
        yield LF.worstSeverity, Literal(found.severity)
        yield LF.trouble, Literal(found.says)


def _summary(faults: list[Fault]) -> Summary:
    worst = min(faults, key=lambda each: (-SEVERITIES.index(each.trouble.severity), each.trouble.id))
    return Summary(len(faults), worst.trouble.severity, worst.trouble.says)
