"""Objects that links of robots hold: where they are, and what clients state about it. Pure; metre.

A held object has its pose in the frame of its link, so that it moves with that. Without the robot, or without its
placement, its place in the world is unknown.
"""

import math
import struct
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache

from msgspec.structs import replace

from linked_fleet_gateway.api import Conflict, Link, Pose, Robot, UnprocessableContent, link_path, thing_at
from linked_fleet_gateway.extensions.world.hands import palm_of
from linked_fleet_gateway.extensions.world.placement import WORLD, pose_in_world
from linked_fleet_gateway.extensions.world.scene import (
    MAX_OBJECTS,
    Box,
    Cylinder,
    Geometry,
    Held,
    SceneObject,
    Sphere,
    TriangleMesh,
)
from linked_fleet_state.gripper import Gripper
from linked_fleet_state.kinematics import compose, inverse

Robots = Mapping[str, Robot]
FARTHEST_M = 0.5
"""The distance of an object from the origin of the link that carries the fingers beyond which no gripper grasps it."""


def path_of(held: Held, robots: Robots) -> str:
    """Return the path of the link that holds something; empty if that link is not known."""
    robot = robots.get(held.robot)
    if robot is None or robot.model is None or held.link not in robot.model.links:
        return ""
    return link_path(robot.name, robot.model, held.link)


def pose_of(thing: SceneObject, robots: Robots) -> Pose | None:
    """Return the present pose of an object in the world; None if it is held where that is unknown."""
    if (held := thing.held) is None:
        return thing.pose
    link = _link_in_world(held.robot, held.link, robots)
    return None if link is None else compose(link, held.pose)


def _link_in_world(name: str, link: str, robots: Robots) -> Pose | None:
    robot = robots.get(name)
    return None if robot is None or robot.model is None else pose_in_world(robot, link)


def in_hand(robot: Robot, gripper: Gripper, segment: str, thing: SceneObject) -> Held | None:
    """Return how a gripper holds an object that it grasps now; None if it is unknown where that is in its hand."""
    link = "" if robot.model is None else palm_of(robot.model, gripper)
    pose = pose_of(thing, {robot.name: robot})
    on_link = None if pose is None or not link else relative_to(pose, robot, link)
    return None if on_link is None else Held(robot.name, link, on_link, segment)


def relative_to(pose: Pose, robot: Robot, link: str) -> Pose | None:
    """Return a pose in the world in the frame of a link; None if it is unknown where that is."""
    there = pose_in_world(robot, link)
    return None if there is None else compose(inverse(there), pose)


def held_by(robot: Robot, objects: Mapping[str, SceneObject]) -> dict[str, SceneObject]:
    """Return the objects that a robot holds, by id."""
    return {id: each for id, each in objects.items() if each.held is not None and each.held.robot == robot.name}


def gap_m(held: Held, geometry: Geometry) -> float:
    """Return a lower bound of the distance between the origin of the link and what it holds."""
    return math.hypot(*held.pose.position_m) - _radius_m(geometry)


def extent_m(held: Held, geometry: Geometry) -> float:
    """Return a bound of the distance of what a link holds from the origin of the link."""
    return math.hypot(*held.pose.position_m) + _radius_m(geometry)


@lru_cache(maxsize=MAX_OBJECTS)
def _radius_m(geometry: Geometry) -> float:
    match geometry:
        case Box(size):
            return math.hypot(*size) / 2
        case Sphere(radius):
            return radius
        case Cylinder(radius, length):
            return math.hypot(radius, length / 2)
        case TriangleMesh(stl):
            faces = struct.iter_unpack("<12x9f2x", memoryview(stl)[84:])
            return max(math.hypot(*face[i : i + 3]) for face in faces for i in (0, 3, 6))


@dataclass(frozen=True)
class StatedObject:
    """An object as a client states it: with its pose in the ``frame``, and the path of the link that it is held by."""

    thing: SceneObject
    frame: str
    held_by: str

    def settled(self, robots: Robots, present: SceneObject | None, now_ns: int) -> SceneObject:
        """Return the object in place of ``present``. Raises UnprocessableContent, Conflict."""
        before = None if present is None else present.held
        if not self.held_by:
            return replace(self.thing, pose=self._in_world(robots), decided_ns=0 if before is None else now_ns)
        if self.thing.kind == "zone":
            raise UnprocessableContent("A lf:KeepOutZone is empty space, which nothing holds: leave lf:heldBy out.")
        robot, link = _link_at(self.held_by, robots)
        held = Held(robot.name, link, self._on(robot, link, robots))
        if before is not None and (before.robot, before.link) == (robot.name, link):
            held = replace(held, gripper=before.gripper, since_ns=before.since_ns)
        return replace(self.thing, pose=_last_pose(present, self.thing), held=held, decided_ns=now_ns)

    def _in_world(self, robots: Robots) -> Pose:
        if self.frame == WORLD:
            return self.thing.pose
        robot, link = _link_at(self.frame, robots)
        there = pose_in_world(robot, link)
        if there is None:
            raise _unknown(robot, link)
        return compose(there, self.thing.pose)

    def _on(self, robot: Robot, link: str, robots: Robots) -> Pose:
        """Return the pose in the frame of the link that holds it."""
        if self.frame == self.held_by:
            return self.thing.pose
        found = relative_to(self._in_world(robots), robot, link)
        if found is None:
            raise _unknown(robot, link)
        return found


def _last_pose(present: SceneObject | None, stated: SceneObject) -> Pose:
    """Return the last pose that an object had on its own."""
    return stated.pose if present is None else present.pose


def _link_at(path: str, robots: Robots) -> tuple[Robot, str]:
    robot, part = thing_at(path, robots) or (None, None)
    if robot is None or not isinstance(part, Link):
        raise UnprocessableContent(f"{path[:200]} is not a link of a robot.")
    return robot, part.name


def _unknown(robot: Robot, link: str) -> Conflict:
    return Conflict(
        f"It is unknown where {link} of {robot.name} is in the world, and so is where the object is: PUT the placement "
        "of the robot, or state lf:position in the frame of the link that holds it, with lf:inFrame."
    )
