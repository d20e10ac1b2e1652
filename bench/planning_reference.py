"""Paths of another planner in the scenes of ``bench.planning_scenes``: RRT-Connect of OMPL, in the same scene.

Its states are compared with what is around by the scene that the gateway's search has, and its paths are timed as the
gateway times its own, so that only paths are compared. The results are kept, so that others need no OMPL.
"""

import itertools
import tempfile
import time
from importlib.metadata import version
from pathlib import Path
from typing import NamedTuple

import msgspec
import numpy as np
from msgspec import Struct
from roboplan.core import JointPath

from bench.planning_scenes import ARMS, Scene, scene
from bench.table import UnavailableError
from linked_fleet_gateway.extensions.planning.finder import STEP
from linked_fleet_gateway.extensions.planning.planner_scene import PlannerScene, SceneWriter
from linked_fleet_gateway.extensions.planning.timing import fastest
from linked_fleet_gateway.extensions.world.surfaces import Array
from linked_fleet_gateway.extensions.world.surroundings import object_bodies

FILE = Path(__file__).parent / "scenes" / "planning.json"
WITHIN_S, RUNS = 10.0, 10
_MOST_FAILURES = 2
"""Runs without a path, after which a scene counts as one in which OMPL finds none."""
_SIMPLIFYING_S = 2.0


class Reference(Struct, frozen=True, array_like=True):
    """The outcome of OMPL in a scene: how many of its runs found a path, and the time of the fastest motion; 0 if none.

    ``digest`` is that of the scene.
    """

    seed: int
    digest: int
    runs: int
    found: int
    best_s: float


class References(Struct):
    """The results by arm. ``software`` are the versions of what found them."""

    software: dict[str, str]
    within_s: float
    arms: dict[str, list[Reference]]


def read() -> References:
    """Return the results that are kept. Raises UnavailableError."""
    try:
        return msgspec.json.decode(FILE.read_bytes(), type=References)
    except FileNotFoundError as error:
        raise UnavailableError(f"{FILE.name} is missing: python -m bench.planning --reference") from error


def extend(scenes: int, within_s: float) -> None:
    """Add the results of scenes that have none, in turn of each arm, until the time is over; each is kept at once."""
    software = {name: version(name) for name in ("ompl", "roboplan-core", "roboplan-toppra")}
    kept = read() if FILE.exists() else References(software, WITHIN_S, {})
    ends_s = time.monotonic() + within_s
    for seed, name in itertools.product(range(scenes), ARMS):
        found = kept.arms.setdefault(name, [])
        if time.monotonic() > ends_s:
            return
        if seed not in {each.seed for each in found}:
            found.append(reference(scene(name, seed)))
            print(name, found[-1], flush=True)
            _write(kept)


def _write(kept: References) -> None:
    """Write a line for each scene, so that changes can be compared."""
    for rows in kept.arms.values():
        rows.sort(key=lambda row: row.seed)
    arms = [
        f'"{name}":[\n' + ",\n".join(msgspec.json.encode(each).decode() for each in rows) + "\n]"
        for name, rows in kept.arms.items()
    ]
    head = f'"software":{msgspec.json.encode(kept.software).decode()},"within_s":{kept.within_s}'
    FILE.parent.mkdir(exist_ok=True)
    FILE.with_suffix(".new").write_text("{" + head + ',"arms":{\n' + ",\n".join(arms) + "\n}}\n")
    FILE.with_suffix(".new").replace(FILE)


def reference(of: Scene) -> Reference:
    """Return what OMPL finds in a scene."""
    asked, runs, durations = of.question(0, WITHIN_S), 0, list[float]()
    with tempfile.TemporaryDirectory() as folder:
        start = asked.around.paths[0].start
        writer = SceneWriter(of.arm.robot, start, asked.bounds, Path(folder))
        made = writer.build(list(object_bodies(asked.around, of.objects)), (of.goal,))
        speeds = np.array([asked.bounds[name].speed for name in made.joints])
        begin, end = (np.array([at[name] for name in made.joints]) for at in (start, of.goal))
        limits = [(asked.bounds[name].lower, asked.bounds[name].upper) for name in made.joints]
        problem = _Problem(made, begin, end, limits)
        while runs < RUNS and not (runs == _MOST_FAILURES and not durations):
            runs += 1
            path = problem.solved()
            timed = None if path is None else fastest(made.scene, path, speeds)
            durations += [] if timed is None else [timed.duration_s]
    return Reference(of.seed, of.digest(), runs, len(durations), round(min(durations, default=0.0), 3))


class _Problem(NamedTuple):
    made: PlannerScene
    start: Array
    goal: Array
    limits: list[tuple[float, float]]

    def solved(self) -> JointPath | None:
        """Return a path of RRT-Connect, simplified; None if none was found in time."""
        from ompl import base, geometric, util

        util.setLogLevel(util.LOG_WARN)
        scene, count = self.made.scene, len(self.made.joints)
        space, bounds = base.RealVectorStateSpace(count), base.RealVectorBounds(count)
        for n, (low, high) in enumerate(self.limits):
            bounds.setLow(n, low)
            bounds.setHigh(n, high)
        space.setBounds(bounds)
        setup, ends = geometric.SimpleSetup(space), (space.allocState(), space.allocState())
        for state, row in zip(ends, (self.start, self.goal), strict=True):
            state[0:count] = row.tolist()
        setup.setStateValidityChecker(lambda state: not scene.hasCollisions(np.array(state[0:count])))
        setup.getSpaceInformation().setStateValidityCheckingResolution(STEP / space.getMaximumExtent())
        setup.setStartAndGoalStates(*ends)
        setup.setPlanner(geometric.RRTConnect(setup.getSpaceInformation()))
        setup.solve(WITHIN_S)
        if not setup.haveExactSolutionPath():
            return None
        setup.simplifySolution(_SIMPLIFYING_S)
        found = JointPath()
        found.joint_names = scene.getJointNames()
        found.positions = [np.array(each[0:count]) for each in setup.getSolutionPath().getStates()]
        return found
