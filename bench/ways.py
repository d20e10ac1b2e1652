"""Time of planning the way of a base on a floor of 20 by 20 m with 50 objects, by the process of a gateway.

Each scene is another one, with one of two bases. Users ask for a place, a place with a heading, or a place beside an
object. In every fifth scene the goal is in a room without a door, which is found out last.
"""

import asyncio
import math
import os
import random
import time
from collections.abc import Iterator, Sequence

import msgspec

from bench.table import Row, bounded, known, percentile
from linked_fleet_agent.planar import Pose
from linked_fleet_gateway.extensions.navigation.extension import PLAN_S, PLANNER
from linked_fleet_gateway.extensions.navigation.messages import (
    Answer,
    Blocked,
    Goal,
    Near,
    Obstacle,
    PlanWay,
    Point,
    Polygon,
    ToPose,
    Way,
)
from linked_fleet_gateway.extensions.navigation.swept import hull, meets
from linked_fleet_gateway.serving import QuestionProcess

SCENES, SIDE_M, OBJECTS = 200, 20.0, 50
MOST_P95_MS = 300.0
_ROOM_EACH = 5
ROUND: Polygon = hull([(0.27 * math.cos(math.tau * n / 16), 0.27 * math.sin(math.tau * n / 16)) for n in range(16)])
LONG: Polygon = ((0.5, -0.25), (0.5, 0.25), (-0.5, 0.25), (-0.5, -0.25))


def rows(_: float, scenes: int = SCENES) -> list[Row]:
    """Return the times of the ways that were found, and of the answers that there is none."""
    first_ms, taken = asyncio.run(_measured(list(questions(scenes))))
    ways = [ms for ms, answer in taken if isinstance(answer, Way)]
    blocked = [ms for ms, answer in taken if isinstance(answer, Blocked)]
    assert ways and blocked and len(ways) + len(blocked) == scenes, taken
    where = f"among {OBJECTS} objects"
    return [
        known("first plan of a way, with the start of its process", "ms", first_ms),
        known(f"ways {where} that were found", "%", 100 * len(ways) / scenes),
        *_times(f"way {where}, found", ways),
        *_times(f"way {where}, found to be blocked", blocked),
    ]


def _times(name: str, taken_ms: Sequence[float]) -> list[Row]:
    return [
        known(f"{name}, p50", "ms", percentile(taken_ms, 0.5)),
        bounded(f"{name}, p95", "ms", percentile(taken_ms, 0.95), MOST_P95_MS),
        known(f"{name}, longest", "ms", max(taken_ms)),
    ]


async def _measured(asked: Sequence[PlanWay]) -> tuple[float, list[tuple[float, Answer]]]:
    """Return the time of the first answer of the process, and then the time and answer of each question."""
    process = QuestionProcess[PlanWay, Answer](PLANNER, msgspec.msgpack.Decoder(Answer))
    try:
        first_ms, _ = await _timed(process, asked[0])
        return first_ms, [await _timed(process, each) for each in asked]
    finally:
        await process.end()


async def _timed(process: QuestionProcess[PlanWay, Answer], asked: PlanWay) -> tuple[float, Answer]:
    begin = time.perf_counter()
    answer = await process.ask(asked, PLAN_S)
    return (time.perf_counter() - begin) * 1e3, answer


# -- scenes -----------------------------------------------------------------------------------------------------------


def questions(count: int) -> Iterator[PlanWay]:
    """Yield questions, the same in each run."""
    for seed in range(count):
        chance = random.Random(seed)  # noqa: S311
        walls, goal_at = _room(chance) if seed % _ROOM_EACH == 0 else ([], _place(chance))
        boxes = [*walls, *(_box(_place(chance), chance) for _ in range(OBJECTS - len(walls)))]
        things = tuple(Obstacle(f"/world/objects/{number}", (each,)) for number, each in enumerate(boxes))
        outline = chance.choice((ROUND, LONG))
        goal = _goal(chance, goal_at, things if not walls else ())
        yield PlanWay(_start(chance, goal_at, boxes), goal, outline, things, lateral=chance.random() < 0.2)


def _place(chance: random.Random) -> Point:
    return chance.uniform(0, SIDE_M), chance.uniform(0, SIDE_M)


def _goal(chance: random.Random, at: Point, things: Sequence[Obstacle]) -> Goal:
    if things and chance.random() < 1 / 3:
        thing = chance.choice(things)
        return Near(thing.name, thing.polygons[0][0])
    return ToPose(at, chance.choice((None, chance.uniform(-math.pi, math.pi))))


def _start(chance: random.Random, goal: Point, boxes: Sequence[Polygon]) -> Pose:
    """Return a place off the goal at which a base may turn."""
    while True:
        pose = Pose(*_place(chance), chance.uniform(-math.pi, math.pi))
        here = _rectangle(pose[:2], (0.65, 0.65), 0.0)
        if math.dist(pose[:2], goal) > 5.0 and not any(meets(here, each) for each in boxes):
            return pose


def _room(chance: random.Random) -> tuple[list[Polygon], Point]:
    """Return the walls of a room without a door, and a place in it."""
    half = chance.uniform(1.0, 3.0)
    x, y = chance.uniform(4, SIDE_M - 4), chance.uniform(4, SIDE_M - 4)
    walls = [_rectangle((x, y + side * half), (half + 0.1, 0.1), 0.0) for side in (-1, 1)]
    walls += [_rectangle((x + side * half, y), (0.1, half + 0.1), 0.0) for side in (-1, 1)]
    return walls, (x, y)


def _box(at: Point, chance: random.Random) -> Polygon:
    return _rectangle(at, (chance.uniform(0.1, 0.6), chance.uniform(0.1, 0.6)), chance.uniform(0, math.pi))


def _rectangle(at: Point, half: Point, heading: float) -> Polygon:
    cosine, sine = math.cos(heading), math.sin(heading)
    corners = ((half[0], -half[1]), half, (-half[0], half[1]), (-half[0], -half[1]))
    return tuple((at[0] + x * cosine - y * sine, at[1] + x * sine + y * cosine) for x, y in corners)


def main() -> None:
    print(f"{os.cpu_count()} processors, load {os.getloadavg()[0]:.1f} before")
    for row in rows(1.0):
        print(row)


if __name__ == "__main__":
    main()
