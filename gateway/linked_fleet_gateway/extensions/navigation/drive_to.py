"""The actions ``driveTo`` and ``driveNear``: what is asked for, and their invocations."""

import math
import time
from dataclasses import dataclass, replace

from linked_fleet_agent import planar
from linked_fleet_base.errors import Members
from linked_fleet_gateway.api import (
    ActionRequest,
    Busy,
    Call,
    Conflict,
    Core,
    Graph,
    Invocation,
    NamedNode,
    Operation,
    Robot,
    UnprocessableContent,
    robot_path,
    thing_at,
)
from linked_fleet_gateway.extensions.navigation import floor
from linked_fleet_gateway.extensions.navigation.drive import DrivenBase, offer_of
from linked_fleet_gateway.extensions.navigation.messages import EDGE, MAP, Goal, Near, Strip, ToPose, Way
from linked_fleet_gateway.extensions.navigation.traffic import Traffic
from linked_fleet_gateway.extensions.navigation.trips import DriveError, NoWayError, Trip, UnplannedError
from linked_fleet_gateway.extensions.world.driving import on_floor
from linked_fleet_gateway.extensions.world.map_resources import MAP as MAP_PATH
from linked_fleet_gateway.extensions.world.placement import LF as WORLD_TERMS
from linked_fleet_gateway.extensions.world.placement import WORLD, number_of
from linked_fleet_gateway.extensions.world.service import World
from linked_fleet_gateway.faces import drive_limits, relative_pose
from linked_fleet_gateway.serving import Caller
from linked_fleet_rdf.graph import METRE, RADIAN, Node
from linked_fleet_rdf.vocabulary import MATHS
from linked_fleet_state.driving import placed
from linked_fleet_state.model import Pose

LF = WORLD_TERMS.extended("DriveTo DriveNear Arrival near corridor start end width heading positionError headingError")
SEGMENTS = ("driveTo", "driveNear")
NEWER = "a newer drive of the base has taken over"
_USED = 0.7
"""The share of its speed by which a base follows a path."""


class Unreachable(Conflict):
    """No way leads to the goal; ``blockers`` are the IRIs of what is around the base or the goal."""

    code, title = "unreachable", "No way leads to the goal"

    def __init__(self, detail: str, blockers: list[str]) -> None:
        super().__init__(detail)
        self.blockers = blockers

    @property
    def members(self) -> Members:
        return super().members | {"blockers": self.blockers}


class DriveFailed(Conflict):
    """The base has not reached its goal."""

    code, title = "drive-failed", "The base has not reached its goal"


@dataclass(frozen=True)
class _Wanted:
    """The goal that a request asks for. ``thing`` is the path of the thing to be near, ``frame`` that of the goal."""

    x: float = 0.0
    y: float = 0.0
    heading: float | None = None
    frame: str = WORLD
    thing: str = ""
    corridor: tuple[Strip, ...] = ()
    speed: float = 1.0


def wanted_by(request: ActionRequest) -> _Wanted:
    """Return what a validated body asks for. Raises UnprocessableContent for a thing of another fleet."""
    body, root = request.body, request.body.root
    corridor = tuple(_strip(request, node) for node in body.nodes(root, LF.corridor))
    speed = body.number(root, LF.speedScale)
    robot = request.required_robot()
    said = _Wanted(corridor=corridor, speed=min(1.0 if speed is None else speed, robot.speed_scale))
    if (thing := _path(request, body.node(root, LF.near))) is not None:
        return replace(said, thing=thing)
    x, y = _point(request, body.node(root, LF.position))
    looks, frame = body.node(root, LF.heading), _path(request, body.node(root, LF.inFrame))
    return replace(said, x=x, y=y, heading=None if looks is None else body.quantity(looks), frame=frame or WORLD)


def _strip(request: ActionRequest, node: Node) -> Strip:
    body = request.body
    width = body.node(node, LF.width)
    assert width is not None
    return Strip(
        _point(request, body.node(node, LF.start)), _point(request, body.node(node, LF.end)), body.quantity(width)
    )


def _point(request: ActionRequest, node: Node | None) -> tuple[float, float]:
    assert node is not None
    scale = request.body.unit(node)
    return number_of(request.body, node, MATHS.x) * scale, number_of(request.body, node, MATHS.y) * scale


def _path(request: ActionRequest, node: Node | None) -> str | None:
    if node is None:
        return None
    if not isinstance(node, NamedNode) or not node.value.startswith(request.base + "/"):
        raise UnprocessableContent(f"{str(node)[:200]} is not a thing of this fleet.")
    return node.value[len(request.base) :]


class DriveTo:
    """Plans both actions."""

    def __init__(self, core: Core, world: World, traffic: Traffic) -> None:
        self._core, self._world, self._traffic = core, world, traffic

    def plan(self, request: ActionRequest) -> Operation:
        robot, wanted = request.required_robot(), wanted_by(request)
        offer_of(robot)
        if wanted.thing and self._obstacle_of(wanted.thing) == robot.name:
            raise UnprocessableContent(f"{robot.name} is always near itself; name another thing, or a position.")

        async def rehearse(caller: Caller) -> float:
            trip = self._trip(robot, wanted, request.base, caller)
            return _takes_s(robot, await self._first_way(trip, request.base), wanted.speed)

        async def run(call: Call) -> None:
            call.accept()
            await self._end_earlier(robot, call)
            trip = self._trip(robot, wanted, request.base, call.caller)
            _report(trip, call, robot)
            await self._drive(trip)
            _set_result(call, robot, trip)

        return Operation(run, rehearse=rehearse)

    def _trip(self, robot: Robot, wanted: _Wanted, base: str, caller: Caller) -> Trip:
        driven = DrivenBase(self._core, self._world, robot, base, caller, wanted.speed)
        by_person = robot.lease is not None and robot.lease.priority == "person"
        goal = self._goal(wanted, caller)
        return Trip(driven, goal, (0 if by_person else 1, time.time_ns()), wanted.corridor)

    def _goal(self, wanted: _Wanted, caller: Caller) -> Goal:
        """Return the goal in the world, now. Raises UnprocessableContent, Conflict."""
        pose = self._pose_of(wanted.thing or wanted.frame, caller)
        if wanted.thing:
            return Near(self._obstacle_of(wanted.thing), (pose.position_m[0], pose.position_m[1]))
        frame = on_floor(pose) or planar.Pose(*pose.position_m[:2], 0.0)
        found = placed(planar.Pose(wanted.x, wanted.y, wanted.heading or 0.0), frame)
        return ToPose(found[:2], None if wanted.heading is None else math.remainder(found.heading, math.tau))

    def _pose_of(self, path: str, caller: Caller) -> Pose:
        seen = {name: robot for name, robot in self._core.robots.items() if caller.visible_robots.includes(name)}
        try:
            pose = relative_pose(path, WORLD, seen, self._world.poses()).pose
        except LookupError as error:
            raise UnprocessableContent(f"{path[:200]} is not a thing of the world.") from error
        if pose is None:
            raise Conflict(f"Where {path[:200]} is in the world is unknown.")
        return pose

    def _obstacle_of(self, path: str) -> str:
        found = thing_at(path, self._core.robots)
        return self._world.holder_of(path) or path if found is None else found[0].name

    async def _first_way(self, trip: Trip, base: str) -> Way | None:
        try:
            return await self._traffic.first_way(trip)
        except NoWayError as error:
            blockers = [base + _path_of(name) for name in error.by if name not in ("", EDGE)]
            raise Unreachable(_sentence(error), blockers) from error
        except UnplannedError as error:
            raise Busy(_sentence(error)) from error
        except DriveError as error:
            raise DriveFailed(_sentence(error)) from error

    async def _end_earlier(self, robot: Robot, call: Call) -> None:
        for one in drives_of(self._core, robot.name):
            if one.id != call.id:
                await self._core.cancel(one.id, NEWER)

    async def _drive(self, trip: Trip) -> None:
        try:
            await self._traffic.run(trip)
        except DriveError as error:
            raise DriveFailed(_sentence(error)) from error


def drives_of(core: Core, robot: str) -> list[Invocation]:
    """Return the drives of a robot to a goal that have not ended, at whichever gateway."""
    return [one for each in SEGMENTS for one in core.running(f"{robot_path(robot)}actions/{each}")]


def _path_of(name: str) -> str:
    """Return the path of an obstacle."""
    if name == MAP:
        return MAP_PATH
    return name if name.startswith("/") else robot_path(name)


def _sentence(error: DriveError) -> str:
    said = str(error)
    return said[:1].upper() + said[1:] + "."


def _takes_s(robot: Robot, way: Way | None, speed: float) -> float:
    """Return about how long a way takes; 0 if others have to leave it first."""
    limits = drive_limits(robot)
    return 0.0 if way is None or limits is None else way.length_m / (_USED * speed * limits.linear)


def _report(trip: Trip, call: Call, robot: Robot) -> None:
    """Report what the drive does, and how near it is to its goal."""
    begin_m, said = _left_m(trip, robot), ""

    def progress() -> float:
        return 1.0 - _left_m(trip, robot) / max(begin_m, 1e-6)

    def report(reason: str) -> None:
        nonlocal said
        said = reason
        call.report(progress(), reason)

    def moved(pose: planar.Pose) -> None:
        call.report(progress(), said)

    trip.report = report
    assert isinstance(trip.base, DrivenBase)
    trip.base.tell = moved


def _left_m(trip: Trip, robot: Robot) -> float:
    at = floor.standing(robot)
    return math.dist(at[:2], trip.goal.at) if isinstance(trip.goal, ToPose | Near) else 0.0


def _set_result(call: Call, robot: Robot, trip: Trip) -> None:
    """Set how far from its goal the base stands, by its odometry."""
    if not isinstance(trip.goal, ToPose):
        return
    at, graph = floor.standing(robot), Graph()
    root = graph.blank(LF.Arrival)
    graph.scalar(root, LF.positionError, round(math.dist(at[:2], trip.goal.at), 4), METRE)
    if trip.goal.heading is not None:
        turn = abs(math.remainder(at.heading - trip.goal.heading, math.tau))
        graph.scalar(root, LF.headingError, round(turn, 4), RADIAN)
    call.set_output(graph.triples, root)
