"""Snapshots of the fleet for the query process, reduced to changes."""

from collections.abc import Callable
from itertools import islice

from linked_fleet_gateway.extensions.query.messages import Member, News, RobotFacts
from linked_fleet_gateway.fleet.fleet import Fleet
from linked_fleet_gateway.fleet.invocations import FLEET, Invocation, Invocations
from linked_fleet_gateway.fleet.robot import Robot
from linked_fleet_gateway.resources.branches import Branches
from linked_fleet_gateway.resources.paths import robot_path

MAX_ENDED = 20
"""Number of ended invocations sent for each robot and for the fleet: the most recent ones."""

"""Returns triples that a branch adds to the dataset of the caller, by the path of their graph.

Blank node labels must be unique among all contributions to one graph.
"""


class Feed:
    """The state known to one query process.

    Call ``news`` and encode its result in one turn of the event loop, because it refers to live objects.
    """

    def __init__(self, fleet: Fleet, invocations: Invocations, branches: Callable[[], Branches]) -> None:
        self._fleet, self._invocations, self._branches = fleet, invocations, branches
        self._said: dict[str, tuple[object, ...]] = {}
        self._frames: dict[str, bytes | None] = {}

    def news(self) -> News:
        """Return the changes since the last call."""
        robots, frames = [], {}
        for name, robot in self._fleet.robots.items():
            invocations = recent(self._invocations, name)
            branches = self._branches().linked_from(robot, robot_path(name))
            key = _key(robot, invocations, branches)
            if key != self._said.get(name):
                self._said[name] = key
                robots.append(_said(robot, invocations, [(term.value, path) for term, path in branches]))
            if (frame := robot.payload) is not self._frames.get(name):
                frames[name] = self._frames[name] = frame
        forgotten = list(self._said.keys() - set(self._fleet.robots))
        for name in forgotten:
            del self._said[name]
            self._frames.pop(name, None)
        return News(robots=robots, frames=frames, forgotten=forgotten)

    def of_fleet(self) -> list[Invocation]:
        """Return the invocations of the whole fleet."""
        return recent(self._invocations, FLEET)


def recent(invocations: Invocations, robot: str) -> list[Invocation]:
    """Return the invocations that are not over, and the most recent of the others."""
    ended = (each for each in invocations.of_robot(robot) if each.state.terminal)
    return [*invocations.open_of(robot), *islice(ended, MAX_ENDED)]


def _key(robot: Robot, invocations: list[Invocation], branches: object) -> tuple[object, ...]:
    """Return a key that changes whenever anything but a frame changes."""
    known = [(one.id, one.state, one.progress, one.reason, one.ended_ns, one.preempted_by) for one in invocations]
    said = robot.online, robot.incarnation, robot.news, robot.description, robot.fault
    return *said, robot.lease, robot.settings, dict(robot.targets), known, branches


def _said(robot: Robot, invocations: list[Invocation], branches: list[Member]) -> RobotFacts:
    return RobotFacts(
        name=robot.name,
        online=robot.online,
        incarnation=robot.incarnation,
        description=robot.description,
        fault=robot.fault,
        limit_fault=robot.limit_fault,
        last_seen_ns=robot.last_seen_ns,
        lease=robot.lease,
        settings=dict(robot.settings),
        targets=robot.targets,
        branches=branches,
        invocations=invocations,
    )
