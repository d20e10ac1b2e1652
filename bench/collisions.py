"""The collision check against an independent one: random motions of the demo's robots at their places in the demo.

No motion with a contact may pass, and at most 1 % of the motions without a contact within the same margin may be
refused. Exits with 1 otherwise.
"""

import argparse
import math
import statistics
import sys
import time
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

import numpy as np

from bench.rigid import Around, Rigid
from linked_fleet_agent.mesh_files import mesh_files
from linked_fleet_agent.robots.catalogue import MODELS, data_folder
from linked_fleet_demo.tree import PLACES
from linked_fleet_gateway.extensions.world.collision_check import CLEARANCE_M, check
from linked_fleet_gateway.extensions.world.messages import (
    Answer,
    Check,
    CheckFailed,
    CollisionFound,
    Free,
    MotionPath,
    PathSegment,
    Placement,
)
from linked_fleet_gateway.extensions.world.robot import Robot
from linked_fleet_gateway.extensions.world.shapes import build_robot
from linked_fleet_gateway.extensions.world.surfaces import read_mesh
from linked_fleet_gateway.extensions.world.surroundings import MARGIN_M
from linked_fleet_state.model import Pose

ARMS = {name: model for name, model in MODELS.items() if not model.cut_at}
"""Robots that move joints, and are described by whole files."""
TOLERANCE_M = 0.001  # half of the check's step near other parts
STEP_M = 0.004
MOST_NEEDLESS = 0.01
_CHUNK_M = 0.05
_MOST_SHOWN = 10
_WITHIN_S = 20.0  # speed is not tested here
_MOST_STARTS = 50
Positions = Mapping[str, float]


@dataclass
class Verdicts:
    free: int = 0
    refused: int = 0
    unable: int = 0
    passed: list[str] = field(default_factory=list)
    needless: list[str] = field(default_factory=list)
    cpu_ms: list[float] = field(default_factory=list)


class Scene:
    """The robots of the demo with joints, in their initial poses, for the check and for the independent one."""

    def __init__(self) -> None:
        self.robots: dict[str, Robot] = {}
        self.rigid: dict[str, Rigid] = {}
        self.home: dict[str, dict[str, float]] = {}
        for name, model in ARMS.items():
            file = data_folder() / model.file
            self.rigid[name] = Rigid(file)
            self.robots[name] = robot_of(file.read_text(), self.rigid[name], file)
            names = [each for each in self.robots[name].model.names if each != "universe"]
            self.home[name] = self.rigid[name].complete({each: model.home.get(each, 0.0) for each in names})

    def base(self, name: str) -> Pose:
        x, y, z = PLACES[name]
        return Pose((x, y, z + (MODELS[name].home_height_m if MODELS[name].floating else 0.0)), (0.0, 0.0, 0.0, 1.0))

    def around(self, name: str) -> Around:
        still = []
        for other, rigid in self.rigid.items():
            if other != name:
                offset = np.eye(4)
                offset[:3, 3] = np.subtract(self.base(other).position_m, self.base(name).position_m)
                places = rigid.places(self.home[other])
                still += [(part, offset @ at) for part, at in zip(rigid.parts, places, strict=True)]
        return Around(self.rigid[name], self.robots[name].pairs, still)

    def check(self, name: str, start: Positions, ends: Positions) -> Answer:
        others = tuple(
            Placement(each, each, self.base(each), (self.home[each],)) for each in self.robots if each != name
        )
        me, way = Placement(name, name, self.base(name)), MotionPath(dict(start), (PathSegment(dict(ends)),))
        return check(Check(me, (way,), others, (), _WITHIN_S), self.robots, {})

    def bound(self, name: str, start: Positions, ends: Positions) -> float:
        """Return an upper bound of how far any point of the robot moves."""
        robot = self.robots[name]
        after = self.rigid[name].complete({**start, **ends})
        reach = dict(zip(robot.model.names, robot.reach_m.max(axis=1, initial=0.0), strict=True))
        slides = {each for each, joint in self.rigid[name].joints.items() if joint.kind == "prismatic"}
        return sum(abs(after[each] - start[each]) * (1.0 if each in slides else reach[each]) for each in start)


def robot_of(urdf: str, rigid: Rigid, file: Path) -> Robot:
    paths = mesh_files(urdf, file)
    robot = build_robot(
        urdf, paths.keys(), lambda uri: read_mesh(paths[uri].suffix[1:].lower(), paths[uri].read_bytes())
    )
    assert [body.link for body in robot.bodies] == [part.link for part in rigid.parts]
    return robot


class Trial:
    """Random motions of one robot, and the results of both checks."""

    def __init__(self, scene: Scene, name: str, seed: int) -> None:
        self._scene, self._name, self._around = scene, name, scene.around(name)
        self._rigid, self._random = scene.rigid[name], np.random.default_rng(seed)
        self._always = {key for key, _, apart in self._around.near(scene.home[name], 0.0) if apart <= 0}
        self.verdicts = Verdicts()

    def motion(self) -> None:
        start, ends = self._start(), self._targets(int(self._random.integers(1, 5)))
        began_s = time.thread_time()
        answer = self._scene.check(self._name, start, ends)
        self.verdicts.cpu_ms.append(1e3 * (time.thread_time() - began_s))
        said = f"{answer} from {dict(start)} to {ends}"
        after = self._rigid.complete({**start, **ends})
        self._around.moving({each for each in start if after[each] != start[each]})
        touching = {key for key, own, apart in self._around.near(start, 0.0) if own and apart <= 0}
        contact = partial(self._contact, start, ends, touching)
        if isinstance(answer, Free):
            self.verdicts.free += 1
            if (found := contact(0.0, -TOLERANCE_M)) is not None:
                self.verdicts.passed.append(f"{found}: {said}")
        elif isinstance(answer, CollisionFound):
            self.verdicts.refused += 1
            if contact(CLEARANCE_M + TOLERANCE_M, TOLERANCE_M) is None:
                self.verdicts.needless.append(said)
        else:
            assert isinstance(answer, CheckFailed)
            self.verdicts.unable += 1

    def _targets(self, count: int) -> dict[str, float]:
        free = [each for each in self._rigid.free() if each in self._scene.home[self._name]]
        chosen = self._random.choice(free, size=min(count, len(free)), replace=False).tolist()
        return {each: float(self._random.uniform(*self._rigid.joints[each].limits)) for each in chosen}

    def _start(self) -> dict[str, float]:
        """Return random positions with no more contacts or near objects than at home; home if none are found."""
        self._around.moving(self._rigid.joints.keys())
        for _ in range(_MOST_STARTS):
            start = self._rigid.complete({**self._scene.home[self._name], **self._targets(100)})
            near = list(self._around.near(start, 2 * MARGIN_M))
            if all((key in self._always or apart > 0) if own else apart > 1.5 * MARGIN_M for key, own, apart in near):
                return start
        return dict(self._scene.home[self._name])

    def _contact(
        self, start: Positions, ends: Positions, touching: set[tuple[int, int]], own_m: float, around_m: float
    ) -> str | None:
        """Return a pair that comes closer than this beyond the margin, searched every 4 mm where possible at all."""
        bound = self._scene.bound(self._name, start, ends)
        looked: dict[float, dict[tuple[int, int, bool], float]] = {}

        def near(share: float) -> dict[tuple[int, int, bool], float]:
            """Return, by pair, its distance minus the required distance."""
            if share not in looked:
                moved = {each: start[each] + share * (end - start[each]) for each, end in ends.items()}
                at, found = self._rigid.complete({**start, **moved}), {}
                for key, own, apart in self._around.near(at, _CHUNK_M + MARGIN_M):
                    if not (own and key in touching):
                        found[*key, own] = apart if own else apart - MARGIN_M
                looked[share] = found
            return looked[share]

        chunks = max(1, math.ceil(bound / _CHUNK_M))
        pending = [(i / chunks, (i + 1) / chunks) for i in reversed(range(chunks))]
        while pending:
            low, high = pending.pop()
            one, other, travel = near(low), near(high), bound * (high - low)
            for found in (one, other):
                for (i, j, own), apart in found.items():
                    if apart <= (own_m if own else around_m):
                        return f"{i} and {j} ({'own' if own else 'around'}) {1e3 * apart:.1f} mm"
            if travel > STEP_M and any(apart + other.get(key, _CHUNK_M) <= 2 * travel for key, apart in one.items()):
                middle = (low + high) / 2
                pending += [(middle, high), (low, middle)]
        return None


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=1000, help="motions of each robot")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--robots", nargs="*", default=list(ARMS))
    asked = parser.parse_args()
    scene, failed = Scene(), False
    print("| robot | motions | free | refused | not told | contact passed | needless | CPU ms, median | 95 % | most |")
    print("|---|---|---|---|---|---|---|---|---|---|")
    for name in asked.robots:
        trial = Trial(scene, name, asked.seed)
        for _ in range(asked.count):
            trial.motion()
        found, cpu_ms = trial.verdicts, sorted(trial.verdicts.cpu_ms)
        figures = statistics.median(cpu_ms), cpu_ms[int(0.95 * len(cpu_ms))], cpu_ms[-1]
        counts = asked.count, found.free, found.refused, found.unable, len(found.passed), len(found.needless)
        print(f"| {name} |", *(f"{each} |" for each in counts), *(f"{each:.1f} |" for each in figures), flush=True)
        for title, motions in (("contact passed", found.passed), ("refused needlessly", found.needless)):
            for each in motions[:_MOST_SHOWN]:
                print(f"{name}: {title}: {each}", file=sys.stderr)
        failed |= bool(found.passed) or len(found.needless) > asked.count * MOST_NEEDLESS
    sys.exit(failed)


if __name__ == "__main__":
    main()
