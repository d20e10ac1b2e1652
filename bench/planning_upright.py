"""Planned paths of a Panda among objects on which its hand stays upright, and without that. Radian, metre, second.

The objects are those of the scenes of ``planning``. Start and goal are others, at which the hand is upright.
"""

import argparse
import math
import os
import time
from collections.abc import Iterator
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from msgspec.structs import replace as replace_struct

from bench.planning import quiet
from bench.planning_scenes import Scene, scene
from bench.table import Row, known, markdown, percentile
from linked_fleet_gateway.extensions.planning.finder import find
from linked_fleet_gateway.extensions.planning.keeping import Keeper
from linked_fleet_gateway.extensions.planning.messages import Constraints, PathFound
from linked_fleet_gateway.extensions.world.messages import Free, Positions
from linked_fleet_gateway.extensions.world.questions import legs_through
from linked_fleet_gateway.extensions.world.surroundings import object_bodies

ARM, TIP, UP = "panda", "panda_hand", "-z"
ENDS, WITHIN = math.radians(15), math.radians(25)
"""The largest tilt of the hand at start and goal, and on the path."""
SCENES, WITHIN_S = 30, 10.0
_MOST_ATTEMPTS = 20_000


class Tried(NamedTuple):
    """The outcome of a search: whether the check accepts its path, and its time by the clock."""

    found: bool
    took_s: float


def upright_scenes(count: int) -> Iterator[Scene]:
    """Yield scenes with a start and a goal at which the hand is upright and the arm touches nothing."""
    for seed in range(count):
        it, chance = scene(ARM, seed), np.random.default_rng([seed, 1])
        keeper = Keeper(it.around(()), it.arm.robot, Constraints(TIP, upright=ENDS, axis=UP), it.arm.joints)
        start, goal = _end(it, keeper, chance), _end(it, keeper, chance)
        yield replace(it, start=start, goal=goal)


def _end(it: Scene, keeper: Keeper, chance: np.random.Generator) -> Positions:
    things = list(object_bodies(it.around(()), it.objects))
    for _ in range(_MOST_ATTEMPTS):
        found = it.arm.somewhere(chance)
        if keeper.broken_at(found, 0.0) is None and it.arm.is_free(found, things):
            return found
    raise AssertionError(f"no upright place in scene {it.seed}")


def tried(it: Scene, keeps: Constraints) -> Tried:
    began_s = time.perf_counter()
    with quiet():
        found = find(replace_struct(it.question(1, WITHIN_S), keeps=keeps), it.robots, it.objects, {})
    took_s = time.perf_counter() - began_s
    if not isinstance(found, PathFound):
        return Tried(False, took_s)
    legs = legs_through(found.joints, found.times_s, found.positions, it.start)
    return Tried(isinstance(it.checked(legs), Free), took_s)


def rows(scenes: int) -> Iterator[Row]:
    upright = Constraints(TIP, upright=WITHIN, axis=UP)
    both = [(tried(it, upright), tried(it, Constraints(TIP))) for it in upright_scenes(scenes)]
    for what, trials in (("upright", [one for one, _ in both]), ("without a constraint", [other for _, other in both])):
        times = [each.took_s for each in trials if each.found]
        yield known(f"paths found, {what}", "%", 100 * len(times) / len(trials))
        yield known(f"search for a path, {what}, p50 by the clock", "s", percentile(times, 0.5))
        yield known(f"search for a path, {what}, p95 by the clock", "s", percentile(times, 0.95))


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m bench.planning_upright", description=__doc__)
    parser.add_argument("--scenes", type=int, default=SCENES)
    asked = parser.parse_args()
    print(f"{os.cpu_count()} processors, load {os.getloadavg()[0]:.1f} before")
    print(markdown(list(rows(asked.scenes))))


if __name__ == "__main__":
    main()
