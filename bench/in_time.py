"""The collision check in time: random motions of Panda while UR5 moves in the same space.

Processor time of the check of the whole way, in time, and once UR5 has arrived, which one refused motion may cost
together. What is found free in time is compared with NumPy and FCL, with Panda on the trajectory of its agent and UR5
as early and late as it may be. Exits with 1 if they touch there.
"""

import argparse
import math
import sys
import time
from collections import defaultdict

import numpy as np
from msgspec.structs import replace

from bench.collisions import Scene
from bench.rigid import Around, Array
from linked_fleet_agent.plan import Plan, Start, plan
from linked_fleet_agent.robot import JointFacts, Limits
from linked_fleet_agent.wire.messages import Move
from linked_fleet_gateway.extensions.world.collision_check import check
from linked_fleet_gateway.extensions.world.course import Course, course_of
from linked_fleet_gateway.extensions.world.messages import (
    Answer,
    Check,
    CollisionFound,
    Free,
    MotionPath,
    PathSegment,
    Placement,
)
from linked_fleet_gateway.extensions.world.questions import WITHIN_S, sampled_configurations
from linked_fleet_gateway.extensions.world.schedules import EARLY_S, LATE_S, OnTime, Run
from linked_fleet_state.events import Frames
from linked_fleet_state.model import Pose
from linked_fleet_state.robot import Robot

ME, OTHER = "panda", "ur5"
BASES = {ME: Pose((0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0)), OTHER: Pose((0.8, 0.0, 0.0), (0.0, 0.0, 1.0, 0.0))}
_WIDE = 0.7
_TIMES, _OFFSETS = 40, (-EARLY_S, -EARLY_S / 2, 0.0, LATE_S / 2, LATE_S)


class Motion:
    """A random motion of a robot past the other one: its course, and what its agent makes of it."""

    def __init__(self, scene: Scene, name: str, random: np.random.Generator) -> None:
        rigid = scene.rigid[name]
        joints = [each for each in rigid.free() if each in scene.home[name]][:6]
        chosen = random.choice(joints[1:], size=int(random.integers(0, 4)), replace=False).tolist()
        turned = float(random.uniform(0.3, 2.0)) * float(random.choice((-1.0, 1.0)))
        near = _near_home(scene, name, joints[1:], random) | {joints[0]: turned}
        self.start = rigid.complete({**scene.home[name], **near})
        across = -math.copysign(float(random.uniform(0.3, 2.0)), turned)
        move = Move(_near_home(scene, name, chosen, random) | {joints[0]: across})
        self.ends, scale = move.targets, float(random.uniform(0.2, 1.0))
        robot = Robot(name, lambda name, error: None, Frames())
        robot.model = scene.robots[name].tree
        self.course: Course | None = course_of(robot, move, scale, (PathSegment(dict(move.targets)),), self.start)
        self.planned: Plan = plan(move, scale, [Start(_facts(robot, each), self.start[each]) for each in move.targets])

    def at(self, time_s: float) -> dict[str, float]:
        """Return where the agent has the joints."""
        moved = {name: each.at(max(0.0, time_s))[0] for name, each in self.planned.trajectories.items()}
        return {**self.start, **moved}


def _near_home(scene: Scene, name: str, joints: list[str], random: np.random.Generator) -> dict[str, float]:
    """Return random positions of joints around those at home."""
    found = {}
    for joint in joints:
        (low, high), home = scene.rigid[name].joints[joint].limits, scene.home[name][joint]
        found[joint] = float(random.uniform(max(low, home - _WIDE), min(high, home + _WIDE)))
    return found


def _facts(robot: Robot, name: str) -> JointFacts:
    assert robot.model is not None
    limits = robot.model.joints[name].limits
    return JointFacts(name, limits=Limits(limits.lower, limits.upper, limits.velocity, limits.effort))


class Trials:
    """Random motions, the processor time of each kind of check, and how often each outcome was."""

    def __init__(self, seed: int) -> None:
        self._scene, self._random = Scene(), np.random.default_rng(seed)
        self.cpu_ms, self.counts = defaultdict[str, list[float]](list), defaultdict[str, int](int)

    def run(self) -> None:
        mine, other = Motion(self._scene, ME, self._random), Motion(self._scene, OTHER, self._random)
        if mine.course is None or other.course is None:
            return
        elapsed_s = float(self._random.uniform(0.0, other.planned.duration_s))
        here = other.at(elapsed_s)
        places = sampled_configurations(here, dict(other.course.end))
        asked = Check(
            Placement(ME, ME, BASES[ME]), (MotionPath(mine.start, mine.course.legs),),
            (Placement(OTHER, OTHER, BASES[OTHER], places),), (), WITHIN_S,
        )  # fmt: skip
        answer = self._timed("whole way", asked)
        if not isinstance(answer, CollisionFound) or answer.kind != "robot":
            self.counts["free of the whole way" if isinstance(answer, Free) else "refused for itself"] += 1
            return
        on_time = OnTime(Run(OTHER, "it"), other.course, elapsed_s, 0.0)
        met, times_s = on_time.met()
        stood = replace(asked.robots[0], configurations=(here, *met), times_s=(times_s[0], *times_s))
        answer = self._timed("in time", replace(asked, robots=(stood,), in_time=True))
        if isinstance(answer, Free):
            self.counts["free in time"] += 1
            self.counts["of these with a contact"] += self._touch(mine, other, elapsed_s)
            return
        arrived = replace(asked.robots[0], configurations=(here | dict(other.course.end),))
        answer = self._timed("arrived", replace(asked, robots=(arrived,)))
        self.counts["free later" if isinstance(answer, Free) else "refused"] += 1

    def _timed(self, kind: str, asked: Check) -> Answer:
        began_s = time.thread_time()
        answer = check(asked, self._scene.robots, {})
        self.cpu_ms[kind].append(1e3 * (time.thread_time() - began_s))
        return answer

    def _touch(self, mine: Motion, other: Motion, elapsed_s: float) -> bool:
        """Return True if the robots touch while one is on its way and the other is anywhere in its windows."""
        times_s = np.linspace(0.0, mine.planned.duration_s, _TIMES)
        return any(
            self._contact(mine.at(time_s), other.at(max(elapsed_s, elapsed_s + time_s - late_s)))
            for time_s in times_s.tolist()
            for late_s in _OFFSETS
        )

    def _contact(self, mine: dict[str, float], other: dict[str, float]) -> bool:
        rigid = self._scene.rigid[OTHER]
        base: Array = np.diag([-1.0, -1.0, 1.0, 1.0])
        base[:3, 3] = BASES[OTHER].position_m
        still = [(part, base @ at) for part, at in zip(rigid.parts, rigid.places(other), strict=True)]
        around = Around(self._scene.rigid[ME], (), still)
        return next(around.near(mine, 0.0), None) is not None


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=1000, help="motions")
    parser.add_argument("--seed", type=int, default=1)
    asked = parser.parse_args()
    trials = Trials(asked.seed)
    for _ in range(asked.count):
        trials.run()
    for name, count in sorted(trials.counts.items()):
        print(f"{name}: {count}")
    print("| check | number | CPU ms, median | 95 % | most |\n|---|---|---|---|---|")
    for name, found in trials.cpu_ms.items():
        figures = (float(np.percentile(found, each)) for each in (50, 95, 100))
        print(f"| {name} | {len(found)} |", *(f"{each:.1f} |" for each in figures))
    sys.exit(trials.counts["of these with a contact"] > 0)


if __name__ == "__main__":
    main()
