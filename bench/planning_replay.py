"""Planned motions, followed by an independent check and by MuJoCo's servos. Radian, metre, second."""

from collections.abc import Iterator, Mapping
from itertools import pairwise
from typing import NamedTuple

import fcl
import numpy as np

from bench.planning_forms import corners_of
from bench.planning_scenes import Scene
from bench.rigid import Around, Part
from linked_fleet_agent.robots.catalogue import MODELS, Model, facts_of
from linked_fleet_agent.robots.mujoco_robot import MujocoRobot
from linked_fleet_gateway.extensions.planning.messages import PathFound
from linked_fleet_gateway.extensions.world.messages import Positions
from linked_fleet_gateway.extensions.world.questions import waypoint_velocities
from linked_fleet_gateway.extensions.world.scene import Box, Cylinder, Geometry, Sphere
from linked_fleet_gateway.extensions.world.surfaces import Array
from linked_fleet_gateway.extensions.world.surroundings import se3

SAMPLE_S = 0.002
BETWEEN = 5
"""Places between two ticks of MuJoCo that the independent check looks at."""
_LEAST_M = 0.004
"""The independent check looks again where something may have come nearer by this."""
_FAR_M = 0.06
TICK_S = 0.01
_SETTLING_S = 0.5


class Nearest(NamedTuple):
    """The least distance on a motion, to what is around and between parts of the robot (0: a contact). Metre."""

    around_m: float
    own_m: float


class Motion:
    """The curve through the waypoints of a path that was found, as agents follow it."""

    def __init__(self, scene: Scene, found: PathFound) -> None:
        self.joints, self.times_s = found.joints, np.array((0.0, *found.times_s))
        self._rows = np.array([[scene.start[name] for name in found.joints], *found.positions])
        columns = [waypoint_velocities(self.times_s.tolist(), column) for column in self._rows.T.tolist()]
        self._velocities = np.array(columns).T

    def at(self, time_s: float) -> Positions:
        """Return the positions of the joints on the cubic between two waypoints."""
        n = int(np.clip(np.searchsorted(self.times_s, time_s, "right") - 1, 0, len(self.times_s) - 2))
        step = self.times_s[n + 1] - self.times_s[n]
        s = min(max((time_s - self.times_s[n]) / step, 0.0), 1.0)
        h = (2 * s**3 - 3 * s**2 + 1, -2 * s**3 + 3 * s**2, (s**3 - 2 * s**2 + s) * step, (s**3 - s**2) * step)
        (p0, p1), (v0, v1) = self._rows[n : n + 2], self._velocities[n : n + 2]
        return dict(zip(self.joints, (h[0] * p0 + h[1] * p1 + h[2] * v0 + h[3] * v1).tolist(), strict=True))

    def sampled(self, every_s: float) -> Iterator[Positions]:
        for time_s in np.arange(0.0, float(self.times_s[-1]) + every_s, every_s).tolist():
            yield self.at(time_s)


def nearest(scene: Scene, places: Iterator[Positions]) -> Nearest:
    """Return the least distances along places, by exact meshes and python-fcl; sampled more finely where near."""
    arm, still = scene.arm, [(_part(form.geometry), se3(form.pose).homogeneous) for form in scene.forms]
    around = Around(arm.rigid, arm.pairs, still)
    around.moving(set(arm.joints))
    reach, room, found = _reach(scene), 0.0, {True: _FAR_M, False: _FAR_M}
    before: Positions | None = None
    for place in places:
        room -= 0.0 if before is None else sum(abs(place[name] - before[name]) * reach[name] for name in arm.joints)
        before = place
        if room > 0.0:
            continue
        here = {True: _FAR_M, False: _FAR_M}
        for _, own, apart in around.near(arm.rigid.complete(arm.home | place), _FAR_M):
            here[own] = min(here[own], apart)
        found = {own: min(found[own], here[own]) for own in found}
        room = max(min(here[False], here[True] / 2), _LEAST_M)
    return Nearest(found[False], found[True])


def followed(scene: Scene, motion: Motion) -> list[Positions]:
    """Return where MuJoCo's servos have the joints, at each of their ticks along a motion."""
    arm = scene.arm
    model = MODELS.get(arm.name) or Model(str(arm.file), arm.name, "")
    facts = facts_of(model, arm.file.read_text())
    robot = MujocoRobot(arm.name, facts, arm.home | scene.start, model.home_height_m, arm.file, parts=model.parts)
    names = [joint.name for joint in facts.joints]
    places, end_s = [], float(motion.times_s[-1]) + _SETTLING_S
    robot.read(0.0)
    for now_s in np.arange(TICK_S, end_s, TICK_S).tolist():
        robot.apply(motion.at(now_s))
        seen = dict(zip(names, robot.read(now_s).positions, strict=True))
        places.append({name: seen[name] for name in arm.joints})
    return places


def between(places: list[Positions], count: int) -> Iterator[Positions]:
    """Yield places, and ``count`` - 1 evenly spaced ones between each two."""
    for one, other in pairwise(places):
        for share in np.arange(count) / count:
            yield {name: float(one[name] + share * (other[name] - one[name])) for name in one}


def _reach(scene: Scene) -> Mapping[str, float]:
    """Return how far a joint moves any point of the robot per radian or metre."""
    arm = scene.arm
    ids = {name: arm.robot.model.getJointId(name) for name in arm.joints}
    return {
        name: 1.0 if arm.rigid.joints[name].kind == "prismatic" else float(arm.robot.reach_m[id, arm.moved].max())
        for name, id in ids.items()
    }


def _part(geometry: Geometry) -> Part:
    if isinstance(geometry, Box):
        shape, radius = fcl.Box(*geometry.size_m), float(np.linalg.norm(geometry.size_m)) / 2
    elif isinstance(geometry, Sphere):
        shape, radius = fcl.Sphere(geometry.radius_m), geometry.radius_m
    elif isinstance(geometry, Cylinder):
        shape = fcl.Cylinder(geometry.radius_m, geometry.length_m)
        radius = float(np.hypot(geometry.radius_m, geometry.length_m / 2))
    else:
        corners: Array = corners_of(geometry)
        shape = fcl.BVHModel()
        shape.beginModel(3 * len(corners), len(corners))
        shape.addSubModel(corners.reshape(-1, 3), np.arange(3 * len(corners)).reshape(-1, 3))
        shape.endModel()
        radius = float(np.linalg.norm(corners, axis=2).max())
    return Part("", np.eye(4), shape, np.zeros(3), radius)
