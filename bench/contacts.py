"""Contacts of the demo's simulation beside the collision check: random poses of arms among boxes that are near them."""

import argparse
from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from bench.planning_forms import pose, turned_to
from bench.planning_scenes import Form, Scene, arm
from bench.table import Row, known, markdown
from linked_fleet_agent.robots.contact_model import ContactModel, ContactObject
from linked_fleet_agent.urdf.geometry import Box
from linked_fleet_agent.urdf.poses import ORIGIN, Pose
from linked_fleet_demo.contacts import contact_robot
from linked_fleet_gateway.extensions.world import scene as world
from linked_fleet_gateway.extensions.world.messages import Positions
from linked_fleet_gateway.extensions.world.surroundings import MARGIN_M, MovingRobot, distance, object_bodies

ROBOTS = ("panda", "ur5", "baxter", "tiago")
POSES, BOXES = 25, 6
_SPREAD_M = 0.25


class Pair(NamedTuple):
    """An arm and a box: the distance by the check, and whether the simulation sees a contact."""

    apart_m: float
    touches: bool


def rows(_: float, poses: int = POSES) -> list[Row]:
    pairs = [each for name in ROBOTS for each in _pairs(name, poses)]
    free, met = ([each.touches for each in pairs if test(each.apart_m)] for test in (_is_free, _is_met))
    return [
        known("boxes at least 1 cm away from an arm", "pairs", len(free)),
        known("of these, contacts of the simulation", "pairs", sum(free)),
        known("boxes that an arm touches", "pairs", len(met)),
        known("of these, without a contact of the simulation", "pairs", len(met) - sum(met)),
    ]


def _is_free(apart_m: float) -> bool:
    return apart_m >= MARGIN_M


def _is_met(apart_m: float) -> bool:
    return apart_m <= 0.0


def _pairs(name: str, poses: int) -> Iterator[Pair]:
    it, robot, chance = arm(name), contact_robot(name), np.random.default_rng([1, ROBOTS.index(name)])
    for _ in range(poses):
        start: Positions = it.home | it.somewhere(chance)
        forms = tuple(_boxes(it.tool(start)[0], chance))
        boxes = [_object(n, form) for n, form in enumerate(forms)]
        model = ContactModel([robot], boxes)
        model.place(name, ORIGIN, [start.get(joint, 0.0) for joint in robot.joints])
        touched = {each.other for each in model.contacts()}
        scene, standing = Scene(it, 0, "", forms, start, start), MovingRobot(it.robot, start)
        for thing in object_bodies(scene.around(()), scene.objects):
            shapes = (standing.shape(body) for body in range(len(it.robot.bodies)) if it.robot.anchored[body])
            yield Pair(min(distance(each, thing.shape, MARGIN_M) for each in shapes), thing.name in touched)


def _boxes(at: np.ndarray, chance: np.random.Generator) -> Iterator[Form]:
    for _ in range(BOXES):
        x, y, z = chance.uniform(0.05, 0.3, 3).tolist()
        ahead = chance.normal(size=3)
        across = np.cross(ahead, chance.normal(size=3))
        turn = turned_to(ahead / np.linalg.norm(ahead), across / np.linalg.norm(across))
        yield Form(world.Box((x, y, z)), pose(at + chance.normal(scale=_SPREAD_M, size=3), turn))


def _object(n: int, form: Form) -> ContactObject:
    assert isinstance(form.geometry, world.Box)
    return ContactObject(f"o{n}", Box(form.geometry.size_m), Pose(form.pose.position_m, form.pose.orientation_xyzw))


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m bench.contacts", description=__doc__)
    parser.add_argument("--poses", type=int, default=POSES, help="of each arm")
    print(markdown(rows(0.0, parser.parse_args().poses)))


if __name__ == "__main__":
    main()
