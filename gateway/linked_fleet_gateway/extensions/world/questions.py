"""Questions to the check process about motions: the paths that a motion may take, and what is around the robot.

Radian, metre, second. A motion of joints at rest is linear in joint space; a trajectory passes its waypoints on the
cubics of Fritsch and Carlson, like the agent. Joints that another motion moves meanwhile may be anywhere between their
position and their target. They are checked at both ends, and moving in parallel with this motion.
"""

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import pairwise

from msgspec.structs import replace

from linked_fleet_agent.wire.messages import Follow, Move
from linked_fleet_gateway.api import Motion
from linked_fleet_gateway.extensions.world.collisions import Unchecked
from linked_fleet_gateway.extensions.world.course import Course, course_of
from linked_fleet_gateway.extensions.world.driving import Driving, odometry_of, velocity_of
from linked_fleet_gateway.extensions.world.floor_map import ID as MAP_ID
from linked_fleet_gateway.extensions.world.floor_map import Maps
from linked_fleet_gateway.extensions.world.hands import hand_around, hands_of
from linked_fleet_gateway.extensions.world.held import held_by, path_of
from linked_fleet_gateway.extensions.world.jogging import Jogs, velocities_of
from linked_fleet_gateway.extensions.world.messages import (
    Check,
    DrivenWay,
    HeldObject,
    MotionPath,
    PathSegment,
    Placement,
    Positions,
    Survey,
)
from linked_fleet_gateway.extensions.world.other_motions import (
    CONFIGURATION_STEP,
    MOST_CONFIGURATIONS,
    paths_along,
    thinned,
)
from linked_fleet_gateway.extensions.world.placement import accepts_unchecked, pose_in_world
from linked_fleet_gateway.extensions.world.plane import AT_REST, legs_of
from linked_fleet_gateway.extensions.world.process import Preparation, key_of
from linked_fleet_gateway.extensions.world.scene import SceneObject
from linked_fleet_gateway.extensions.world.schedules import OnTime, Schedules
from linked_fleet_gateway.extensions.world.touch import things_to_touch
from linked_fleet_gateway.faces import View
from linked_fleet_gateway.serving import Act, Live
from linked_fleet_state.driving import Drive, FollowedPath
from linked_fleet_state.jogging import JointDrive
from linked_fleet_state.model import Pose
from linked_fleet_state.robot import Robot


def paths_of(motion: Move | Follow, start: Positions, elsewhere: Mapping[str, float]) -> tuple[MotionPath, ...]:
    """Return the paths from ``start``; ``elsewhere`` are the targets of joints in other motions."""
    return paths_along(_legs(motion, start), start, elsewhere)


def sampled_configurations(start: Positions, ends: Mapping[str, float]) -> tuple[Positions, ...]:
    """Return joint positions at equal steps between ``start`` and ``ends``; the first are the present ones."""
    moved = {name: end - start[name] for name, end in ends.items() if name in start}
    count = min(MOST_CONFIGURATIONS, round(max(map(abs, moved.values()), default=0.0) / CONFIGURATION_STEP + 0.5))
    shares = [(i + 1) / count for i in range(count)]
    return (start, *({name: start[name] + share * way for name, way in moved.items()} for share in shares))


def _legs(motion: Move | Follow, start: Positions) -> tuple[PathSegment, ...]:
    if isinstance(motion, Move):
        return (PathSegment(dict(motion.targets)),)
    return legs_through(motion.joints, motion.times_s, motion.positions, start)


def legs_through(
    joints: Sequence[str], times_s: Sequence[float], positions: Sequence[tuple[float, ...]], start: Positions
) -> tuple[PathSegment, ...]:
    """Return the legs of a trajectory through ``positions`` of ``joints`` at times after the start."""
    times = (0.0, *times_s)
    rows = (tuple(start[joint] for joint in joints), *positions)
    velocities = [waypoint_velocities(times, column) for column in zip(*rows, strict=True)]
    legs = []
    for i, (before, after) in enumerate(pairwise(times)):
        enters, leaves = ({j: v[at] for j, v in zip(joints, velocities, strict=True)} for at in (i, i + 1))
        legs.append(PathSegment(dict(zip(joints, rows[i + 1], strict=True)), after - before, enters, leaves))
    return tuple(legs)


def waypoint_velocities(times: Iterable[float], positions: Iterable[float]) -> list[float]:
    """Return the velocities at the waypoints, from rest to rest (Fritsch and Butland, 1984)."""
    steps = [after - before for before, after in pairwise(times)]
    slopes = [(after - before) / step for (before, after), step in zip(pairwise(positions), steps, strict=True)]
    inner = [_slope(*one, *other) for one, other in pairwise(zip(steps, slopes, strict=True))]
    return [0.0, *inner, 0.0]


def _slope(step: float, slope: float, next_step: float, next_slope: float) -> float:
    if slope * next_slope <= 0.0:
        return 0.0
    weight, next_weight = 2.0 * next_step + step, next_step + 2.0 * step
    return (weight + next_weight) / (weight / slope + next_weight / next_slope)


WITHIN_S = 1.0
"""Processor time for the check of one motion, in seconds."""
_STILL = 0.1
"""A motion of a joint that is slower (rad/s, m/s) begins from rest: what settles or still brakes soon stands."""


class Questions:
    """Creates questions. ``driving`` knows the drives that have begun, ``jogs`` the jogging, ``schedules`` the rest."""

    def __init__(
        self,
        live: Live,
        preparation: Preparation,
        driving: Driving,
        jogs: Jogs,
        objects: Mapping[str, SceneObject],
        maps: Maps,
        schedules: Schedules,
    ) -> None:
        self._live, self._preparation, self._driving, self._jogs = live, preparation, driving, jogs
        self._objects, self._maps, self._schedules = objects, maps, schedules

    def about(self, motion: Motion, robots: list[Robot], sees: View, own: str) -> Check:
        """Return the question about a motion. Raises Unchecked if its way is unknown."""
        robot = motion.robot
        if isinstance(moved := motion.motion, Act):
            return self.followed(robot, moved.path, robots, sees, own)
        start = _positions(robot)
        if missing := [name for name in motion.targets if name not in start]:
            raise Unchecked(
                f"It is unknown if {robot.name} would collide, because the place of {missing[0]} is unknown."
            )
        paths = paths_of(moved, start, self._underway(robot, own))
        asked = self._checking(robot, (*paths, *self._on_its_path(robot, moved, start, own)), robots, sees)
        named = things_to_touch(motion, self._objects, sees)
        return replace(asked, may_touch=named, hand=tuple(sorted(hands_of(robot)))) if named else asked

    def _on_its_path(self, robot: Robot, motion: Move | Follow, start: Positions, own: str) -> Iterator[MotionPath]:
        """Yield the rest of the path that the base follows, with its other joints before, in and after a motion."""
        here, path = odometry_of(robot), self._driving.path_of(robot)
        if here is None or path is None:
            return
        *between, end = _legs(motion, start)
        for way in path.ways(here):
            yield from paths_along(legs_of(way), start, self._underway(robot, own) | end.ends)
            yield from (MotionPath(start | each.ends, legs_of(way)) for each in thinned(between))

    def followed(
        self,
        robot: Robot,
        path: FollowedPath | None,
        robots: list[Robot],
        sees: View,
        own: str,
        *,
        as_they_are: bool = False,
    ) -> Check:
        """Return the question about a path, among the other robots on their ways, or ``as_they_are`` now."""
        here = odometry_of(robot)
        if path is None or here is None:
            raise Unchecked(f"It is unknown if {robot.name} would collide, because its way is unknown.")
        start, elsewhere = _positions(robot), self._underway(robot, own)
        ways = [paths_along(legs_of(way), start, elsewhere) for way in path.ways(here)]
        return self._checking(robot, tuple(each for paths in ways for each in paths), robots, sees, as_they_are)

    def driven(self, robot: Robot, drive: Drive | JointDrive, robots: list[Robot], sees: View, own: str) -> Check:
        """Return the question about a drive. Raises Unchecked if the place of a jogged joint is unknown."""
        if isinstance(drive, JointDrive):
            return self._jogged(robot, drive, robots, sees, own)
        now, before = velocity_of(robot), self._driving.wanted(robot)
        driven = DrivenWay(drive, now, before, _positions(robot), self._underway(robot, own))
        return replace(self._checking(robot, (), robots, sees), driven=driven)

    def _jogged(self, robot: Robot, drive: JointDrive, robots: list[Robot], sees: View, own: str) -> Check:
        start, elsewhere = _positions(robot), self._underway(robot, own)
        if missing := [name for name, each in drive.velocities.items() if each and name not in start]:
            raise Unchecked(
                f"It is unknown if {robot.name} would collide, because the place of {missing[0]} is unknown."
            )
        ways = [paths_along(legs, start, elsewhere) for legs in self._jogs.legs(robot, drive)]
        return self._checking(robot, tuple(each for paths in ways for each in paths), robots, sees)

    def survey(self, robot: Robot, robots: list[Robot], sees: View) -> Survey:
        """Return the question about what stands around a robot, and will be on the ways of others."""
        return Survey(self._checking(robot, (), robots, sees), _positions(robot))

    # -- motions in time --------------------------------------------------------------------------------------------

    def course(self, motion: Motion, own: str) -> Course | None:
        """Return the course of a motion of joints from rest, if nothing else moves its robot; otherwise None."""
        robot, moved, start = motion.robot, motion.motion, _positions(motion.robot)
        others = any(each.is_motion and each.id != own for each in self._live.invocations.open_of_robot(robot.name))
        if isinstance(moved, Act) or others or self._is_driven(robot):
            return None
        velocities, unknown = velocities_of(robot), math.inf if robot.moving else 0.0
        if any(abs(velocities.get(name, unknown)) > _STILL for name in motion.targets):
            return None
        return course_of(robot, moved, motion.speed_scale, _legs(moved, start), start)

    def _is_driven(self, robot: Robot) -> bool:
        driven = self._driving.ends(robot) or self._jogs.ends(robot)
        return bool(driven) or self._driving.path_of(robot) is not None

    def on_time(self, robots: Iterable[Robot]) -> dict[str, OnTime]:
        """Return the motions that keep their times, by the names of the robots, which nothing else moves."""
        found = {each.name: self._schedules.on_time(each) for each in robots if not self._is_driven(each)}
        return {name: each for name, each in found.items() if each is not None}

    def in_time(
        self, asked: Check, legs: tuple[PathSegment, ...], robots: list[Robot], on_time: Mapping[str, OnTime]
    ) -> Check:
        """Return the question if ``legs`` that begin now are free while others keep their times."""
        others = (each for each in robots if each.name != asked.robot.name)
        met = tuple(
            _met_in_time(stood, on_time.get(each.name)) for stood, each in zip(asked.robots, others, strict=True)
        )
        return replace(asked, paths=(MotionPath(asked.paths[0].start, legs),), robots=met, in_time=True)

    def afterwards(self, asked: Check, robots: list[Robot], on_time: Mapping[str, OnTime]) -> Check:
        """Return the question if the way is free once others that keep their times have arrived."""
        others = (each for each in robots if each.name != asked.robot.name)
        arrived = tuple(
            _arrived(stood, on_time.get(each.name)) for stood, each in zip(asked.robots, others, strict=True)
        )
        return replace(asked, robots=arrived)

    def rest(self, robot: Robot, course: Course, robots: list[Robot], sees: View) -> Check:
        """Return the question about the rest of a motion that has begun, in its time if it keeps that."""
        on_time, start = self.on_time(robots), _positions(robot)
        own = on_time.pop(robot.name, None)
        legs = course.rest(course.reached_s(start) if own is None else own.elapsed_s)
        asked = self._checking(robot, (MotionPath(start, legs),), robots, sees)
        return asked if own is None else self.in_time(asked, legs, robots, on_time)

    def _checking(
        self,
        robot: Robot,
        paths: tuple[MotionPath, ...],
        robots: list[Robot],
        sees: View,
        as_they_are: bool = False,
    ) -> Check:
        return Check(
            _asked(robot, self._preparation.key(robot), base_of(robot, sees), self._held(robot, sees)),
            paths,
            tuple(self._stood(each, sees, as_they_are) for each in robots if each is not robot),
            tuple(Placement(id, key_of(each), each.pose) for id, each in self._objects.items() if each.held is None),
            WITHIN_S,
            "" if (floor := self._maps.get(MAP_ID)) is None else floor.obstacles_key,
        )

    def _stood(self, robot: Robot, sees: View, as_it_is: bool) -> Placement:
        name = robot.name if sees.includes(robot.name) else ""
        straight = sampled_configurations(_positions(robot), self._underway(robot, ""))
        along = (*self._schedules.along(robot), *self._driving.along(robot), *self._jogs.along(robot))
        way = () if as_it_is else self._driving.way(robot)
        accepted = accepts_unchecked(robot)
        key, base, held = self._preparation.key_beside(robot), base_of(robot, sees), self._held(robot, sees)
        return Placement(name, key, base, (*straight, *along), accepted, way, held)

    def _held(self, robot: Robot, sees: View) -> tuple[HeldObject, ...]:
        """Return what a robot holds. Raises Unchecked if a link that holds something is not known any more."""
        return tuple(_as_held(id, each, robot, sees) for id, each in held_by(robot, self._objects).items())

    def _underway(self, robot: Robot, own: str) -> dict[str, float]:
        """Return the targets of the robot's joints in other motions that have not ended."""
        ends: dict[str, float] = {}
        for invocation in reversed(self._live.invocations.open_of_robot(robot.name)):
            if invocation.id != own:
                ends |= invocation.targets
        return ends | self._driving.ends(robot) | self._jogs.ends(robot)


def _met_in_time(stood: Placement, on_time: OnTime | None) -> Placement:
    """Return another robot at its times on its way."""
    if on_time is None:
        return stood
    places, times_s = on_time.met()
    here, first = stood.configurations[0], times_s[0]
    return replace(stood, configurations=(here, *places), times_s=(first, *times_s))


def _arrived(stood: Placement, on_time: OnTime | None) -> Placement:
    """Return another robot at its target."""
    if on_time is None:
        return stood
    return replace(stood, configurations=(stood.configurations[0] | on_time.course.end,))


def _positions(robot: Robot) -> Positions:
    """Return the known positions, and those of the joints that carry a base that may drive."""
    known = {name: position for name, position in robot.positions.items() if position == position}
    return known | AT_REST if robot.floats else known


def _asked(robot: Robot, key: str, base: Pose, held: tuple[HeldObject, ...]) -> Placement:
    return Placement(robot.name, key, base, accepts_unchecked=accepts_unchecked(robot), holds=held)


def _as_held(id: str, thing: SceneObject, robot: Robot, sees: View) -> HeldObject:
    assert thing.held is not None
    if not path_of(thing.held, {robot.name: robot}):
        name = robot.name if sees.includes(robot.name) else "another robot"
        raise Unchecked(f"The link of {name} that holds {thing.title} is not known any more: PUT {thing.title} anew.")
    hand = hand_around(robot, thing.held.link)
    return HeldObject(id, key_of(thing), thing.held.link, thing.held.pose, tuple(sorted(hand)))


def base_of(robot: Robot, sees: View) -> Pose:
    """Return the pose of the robot's root link in the world. Raises Unchecked if it is unknown."""
    assert robot.model is not None
    pose = pose_in_world(robot, robot.model.root)
    if pose is None:
        name = robot.name if sees.includes(robot.name) else "another robot"
        raise Unchecked(f"The present place of {name} is unknown, so no path is known to be clear of it.")
    return pose
