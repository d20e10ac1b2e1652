"""Paths of arms round what is in the way: time, and what was found, beside RRT-Connect of OMPL, in random scenes.

``--reference`` finds by OMPL what is compared with, for scenes that lack it, and keeps it in scenes/planning.json.
"""

import argparse
import contextlib
import itertools
import math
import os
import statistics
import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from bench.planning_reference import WITHIN_S, Reference, extend, read
from bench.planning_replay import BETWEEN, SAMPLE_S, Motion, Nearest, between, followed, nearest
from bench.planning_scenes import ARMS, Scene, scene
from bench.table import Row, bounded, known, markdown, percentile
from linked_fleet_gateway.extensions.planning.finder import find
from linked_fleet_gateway.extensions.planning.messages import PathFound
from linked_fleet_gateway.extensions.world.checks import CLOSEST_S
from linked_fleet_gateway.extensions.world.messages import Free
from linked_fleet_gateway.extensions.world.questions import legs_through

SCENES = 6
"""Scenes of each arm in ``make bench``; at most as many as have a reference."""
LEAST_FOUND, MOST_P50_S, MOST_P95_S, MOST_LONGER = 98.0, 0.3, 2.0, 1.1
_PATHS, _SEEDS = 4, 1_000
"""The most paths that a gateway has checked for one motion, and the seeds from one to the next."""


@dataclass(frozen=True)
class Trial:
    """The outcome in a scene: the first path that the check accepts, in that many searches."""

    scene: Scene
    reference: Reference
    wall_s: float
    cpu_s: float
    searches: int
    found: PathFound | None
    refused: int = 0
    exact: Nearest | None = None
    simulated: Nearest | None = None


def rows(_: float, scenes: int = SCENES) -> list[Row]:
    """Return the rows of all arms together, and of each arm those of its times."""
    return _rows([each for name in ARMS for each in measured(name, scenes)])


def _rows(trials: Sequence[Trial]) -> list[Row]:
    return [*_found_rows(trials), *_time_rows(trials), *_path_rows(trials), *_closest_rows(trials)]


def measured(name: str, scenes: int) -> Iterator[Trial]:
    """Yield the trials in the first scenes of an arm that have a reference."""
    for reference in read().arms.get(name, [])[:scenes]:
        it = scene(name, reference.seed)
        if it.digest() != reference.digest:
            raise ValueError(
                f"scene {reference.seed} of {name} is another one than OMPL has seen: remove the file of the "
                "references, and make it anew with --reference"
            )
        yield _replayed(_tried(it, reference))


def _tried(it: Scene, reference: Reference) -> Trial:
    """Return a trial as a gateway would do it: another search if the check refuses what one has found."""
    wall_s, cpu_s, refused = 0.0, 0.0, 0
    for n in range(1, _PATHS + 1):
        began_s, used_s = time.perf_counter(), time.process_time()
        with quiet():
            answer = find(it.question(n * _SEEDS, WITHIN_S), it.robots, it.objects, {})
        wall_s, cpu_s = wall_s + time.perf_counter() - began_s, cpu_s + time.process_time() - used_s
        if not isinstance(answer, PathFound):
            break
        legs = legs_through(answer.joints, answer.times_s, answer.positions, it.start)
        if isinstance(it.checked(legs), Free):
            return Trial(it, reference, wall_s, cpu_s, n, answer, refused)
        refused += 1
    return Trial(it, reference, wall_s, cpu_s, n, None, refused)


def _replayed(trial: Trial) -> Trial:
    if trial.found is None:
        return trial
    it, motion = trial.scene, Motion(trial.scene, trial.found)
    exact = nearest(it, motion.sampled(SAMPLE_S))
    simulated = nearest(it, between(followed(it, motion), BETWEEN))
    return Trial(**{**vars(trial), "exact": exact, "simulated": simulated})


def _found_rows(trials: Sequence[Trial]) -> list[Row]:
    possible = [each for each in trials if each.reference.found]
    share = 100 * sum(each.found is not None for each in possible) / len(possible)
    goal = f">= {LEAST_FOUND:g} %"
    searched = [each for each in trials if each.found is not None or each.refused]
    first = 100 * sum(not each.refused for each in searched) / max(len(searched), 1)
    return [
        Row("paths found where OMPL finds one in 10 s, in as long", "%", share, "", None, goal, share >= LEAST_FOUND),
        known(
            "paths found where OMPL finds none",
            "paths",
            sum(not t.reference.found and t.found is not None for t in trials),
        ),
        known("paths that the check accepts at the first try", "%", first),
    ]


def _time_rows(trials: Sequence[Trial]) -> Iterator[Row]:
    """Yield the times of searches that found a path; repetitions after a refusal by the check count too."""
    trials = [each for each in trials if each.found is not None]
    for what, each in (("by the clock", [t.wall_s for t in trials]), ("of the processor", [t.cpu_s for t in trials])):
        yield bounded(f"search for a path, p50 {what}", "s", percentile(each, 0.5), MOST_P50_S)
        yield bounded(f"search for a path, p95 {what}", "s", percentile(each, 0.95), MOST_P95_S)
    for name in ARMS:
        of_arm = [each.wall_s for each in trials if each.scene.arm.name == name]
        if of_arm:
            yield known(f"search for a path of {name}, p50", "s", percentile(of_arm, 0.5))


def _path_rows(trials: Sequence[Trial]) -> Iterator[Row]:
    found = [
        each for each in trials if each.found is not None and each.exact is not None and each.simulated is not None
    ]
    ratios = sorted(
        each.found.times_s[-1] / each.reference.best_s for each in found if each.found and each.reference.found
    )
    beside = "best of ten runs of OMPL"
    yield _longer(f"duration beside the {beside}, median", statistics.median(ratios))
    yield _longer(f"duration beside the {beside}, p95", percentile(ratios, 0.95))
    yield known(f"duration beside the {beside}, longest", "times", ratios[-1])
    for what, each in (("", [t.exact for t in found]), (", followed by MuJoCo's servos", [t.simulated for t in found])):
        near = [nearest for nearest in each if nearest is not None]
        yield bounded(f"contacts of exact meshes on a path{what}", "paths", sum(min(n) <= 0.0 for n in near), 0)
        yield known(f"least distance to what is around{what}", "mm", 1e3 * min(n.around_m for n in near))


def _closest_rows(trials: Sequence[Trial]) -> Iterator[Row]:
    """Yield what it costs to find where a path comes closest to something, beside the check."""
    costs, uncertain_m = list[float](), list[float]()
    for each in trials:
        if each.found is None:
            continue
        it, found = each.scene, each.found
        legs = legs_through(found.joints, found.times_s, found.positions, it.start)
        began_s = time.process_time()
        it.checked(legs)
        checked_s = time.process_time()
        answer = it.checked(legs, CLOSEST_S)
        costs.append(time.process_time() - checked_s - (checked_s - began_s))
        assert isinstance(answer, Free) and answer.closest is not None
        uncertain_m.append(answer.closest.uncertain_m)
    for name, share in (("p50", 0.5), ("p95", 0.95)):
        what = f"closest distance of a path, beside its check, {name} of the processor"
        yield known(what, "ms", 1e3 * percentile(costs, share))
    yield known("uncertainty of the closest distance, p95", "mm", 1e3 * percentile(uncertain_m, 0.95))


def _longer(name: str, ratio: float) -> Row:
    return bounded(name, "times", ratio, MOST_LONGER)


@contextlib.contextmanager
def quiet() -> Iterator[None]:
    """Let libraries that write to the descriptor of standard output write nowhere: TOPP-RA tells numerical trouble."""
    sys.stdout.flush()
    kept, nowhere = os.dup(1), os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 1)
    try:
        yield
    finally:
        os.dup2(kept, 1)
        os.close(kept)
        os.close(nowhere)


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m bench.planning", description=__doc__)
    parser.add_argument("--scenes", type=int, default=SCENES, help="of each arm")
    parser.add_argument("--reference", action="store_true", help="find by OMPL what is compared with")
    parser.add_argument("--minutes", type=float, default=30.0, help="the most for --reference, which may be continued")
    asked = parser.parse_args()
    if asked.reference:
        extend(asked.scenes, 60 * asked.minutes)
        return
    print(f"{os.cpu_count()} processors, load {os.getloadavg()[0]:.1f} before")
    trials = list[Trial]()
    for each in itertools.chain.from_iterable(measured(name, asked.scenes) for name in ARMS):
        print(_line(each), flush=True)
        trials.append(each)
    print(markdown(_rows(trials)))


def _line(trial: Trial) -> str:
    it, reference = trial.scene, trial.reference
    took = f"{trial.wall_s:.2f} s ({trial.cpu_s:.2f} s of a processor), {trial.refused} refused"
    if trial.found is None:
        return f"{it.arm.name} {it.seed} {it.kind}: none in {took}; OMPL: {reference.found} of {reference.runs}"
    longer = trial.found.times_s[-1] / reference.best_s if reference.found else math.nan
    return f"{it.arm.name} {it.seed} {it.kind}: {took}; {trial.found.times_s[-1]:.2f} s, {longer:.2f} of OMPL"


if __name__ == "__main__":
    main()
