"""Plans the way of a base on the floor, round obstacles seen from above. Metre, radian.

Runs in the process that plans ways. First a way is sought on which the base may turn everywhere, then one on which it
fits as it looks there. The check of motions judges the way again, by the shapes themselves, before the base drives.
"""

import math
import time
from collections.abc import Iterator, Sequence
from itertools import pairwise

import numpy as np
import numpy.typing as npt
from msgspec import structs

from linked_fleet_agent.planar import Pose
from linked_fleet_gateway.extensions.navigation.floor_grid import (
    NOTHING,
    Floats,
    FloorGrid,
    Lattice,
    TooLarge,
    distance_to,
)
from linked_fleet_gateway.extensions.navigation.footprint import Footprint
from linked_fleet_gateway.extensions.navigation.messages import (
    EDGE,
    MAP,
    Answer,
    AsideOf,
    Blocked,
    Near,
    PlanWay,
    Point,
    TooFar,
    ToPose,
    Way,
)
from linked_fleet_gateway.extensions.navigation.region import Bools, region
from linked_fleet_gateway.extensions.navigation.shortest import DIAGONAL, STRAIGHT, search
from linked_fleet_state.driving import through

Costs = npt.NDArray[np.uint8]
MARGIN_M = 0.08
"""Room between the base and everything else: corners are cut by 5 cm, the check of motions keeps 1 cm."""
MOST_M = 200.0
AHEAD_M = 2.0
"""Distance that a base drives on which cannot turn where it stands."""
AROUND_M = (3.0, 15.0)
"""Distances around start and goal within which a way is sought, first and if there is none."""
MOST_POSES = 64
_BESIDE_M = 0.3
_MOST_POCKET, _MOST_NAMES, _MOST_S = 1_000, 5, 1.0
_TIGHT_COST = 4
_SHUT_M = 0.12


def plan(asked: PlanWay) -> Answer:
    """Return the way, or why there is none. A base that cannot turn where it stands drives on straight first."""
    found = _plan(asked)
    if not isinstance(found, Blocked) or found.place != "start":
        return found
    for ahead in _ahead(asked):
        later = _plan(structs.replace(asked, start=ahead))
        if isinstance(later, Way):
            return Way((ahead, *later.poses), later.length_m + math.dist(ahead[:2], asked.start[:2]))
    return found


def _ahead(asked: PlanWay) -> Iterator[Pose]:
    """Yield poses straight ahead, as far as the base fits."""
    around = Footprint(asked.outline)
    for each in asked.obstacles:
        around.add(each.polygons)
    at, step = asked.start, AHEAD_M / 5
    for _ in range(5):
        there = Pose(at.x + step * math.cos(at.heading), at.y + step * math.sin(at.heading), at.heading)
        if not all(around.fits(pose, 0.01) for pose in _between(at, there)):
            return
        yield (at := there)


def _plan(asked: PlanWay) -> Answer:
    answer: Answer = TooFar(MOST_M)
    for around_m in AROUND_M:
        try:
            answer = _Plan(asked, around_m).answer()
        except TooLarge:
            return answer if isinstance(answer, Blocked) else TooFar(MOST_M)
        if not isinstance(answer, Blocked) or answer.place != "between":
            return answer
    return answer


class _Plan:
    """A plan within a rectangle around start and goal."""

    def __init__(self, asked: PlanWay, around_m: float) -> None:
        self._asked, self._names = asked, [each.name for each in asked.obstacles]
        self._print = Footprint(asked.outline)
        points = [
            asked.start[:2],
            *self._goal_points(),
            *(point for each in asked.corridor for point in (each.start, each.end)),
        ]
        low, high = (np.array(edge(points, axis=0), dtype=float) for edge in (np.min, np.max))
        if (high - low).max() > MOST_M:
            raise TooLarge
        self._lattice = Lattice.around((low - around_m).tolist(), (high + around_m).tolist())
        self._grid = FloorGrid(self._lattice, self._print.radius + MARGIN_M + self._lattice.step_m)
        self._fill()
        self._start = self._lattice.cell((asked.start.x, asked.start.y))
        self._roomy = self._grid.clearance_m >= self._print.radius + MARGIN_M
        self._passable = self._grid.clearance_m >= self._print.inner + MARGIN_M
        for each in (self._roomy, self._passable):
            each[[0, -1], :] = each[:, [0, -1]] = False

    def _goal_points(self) -> list[Point]:
        goal = self._asked.goal
        return [] if isinstance(goal, AsideOf) else [goal.at]

    def _fill(self) -> None:
        for number, each in enumerate(self._asked.obstacles):
            self._grid.add(each.polygons, number)
            self._print.add(each.polygons)
        if (cells := self._asked.cells) is not None:
            self._names.append(MAP)
            self._print.add(self._grid.add_cells(cells, len(self._names) - 1))
        if corridor := self._asked.corridor:
            self._names.append(EDGE)
            inside = [
                self._apart([(each.start, each.end)]) <= each.width_m / 2 - self._print.radius for each in corridor
            ]
            self._grid.leave_out(~np.logical_or.reduce(inside), len(self._names) - 1)

    # -- the goal ---------------------------------------------------------------------------------------------------

    def _goals(self) -> set[int]:
        """Return the cells at which the base may end."""
        goal = self._asked.goal
        if isinstance(goal, ToPose):
            return {self._lattice.cell(goal.at)}
        room_m = self._print.radius + MARGIN_M
        if isinstance(goal, Near):
            (thing,) = (each for each in self._asked.obstacles if each.name == goal.name)
            apart = self._apart(thing.polygons)
            free = self._roomy & (apart <= room_m + _BESIDE_M)
        else:
            free = self._roomy & (self._apart(goal.kept_free) >= room_m)
        return set(np.flatnonzero(free).tolist())

    def _apart(self, polygons: Sequence[Sequence[Point]]) -> Floats:
        """Return the distance of each cell from the nearest of some polygons or lines."""
        x, y = self._lattice.points((slice(0, self._lattice.rows), slice(0, self._lattice.columns)))
        found = [distance_to(np.asarray(each, dtype=float), x[None, :], y[:, None]) for each in polygons]
        apart: Floats = np.minimum.reduce(found) if found else np.full_like(self._grid.clearance_m, np.inf)
        return apart

    # -- the way ----------------------------------------------------------------------------------------------------

    def answer(self) -> Answer:
        goals = self._goals()
        if not goals or not self._fits_at_goal():
            return Blocked("goal", self._around_goal())
        cost = np.where(self._roomy, 1, _TIGHT_COST * self._passable).astype(np.uint8)
        cost.flat[self._start] = cost.flat[self._start] or _TIGHT_COST
        self._open_around_start(cost)
        return self._apart_from(goals, cost) or self._with_room(goals) or self._as_it_fits(cost, goals)

    def _fits_at_goal(self) -> bool:
        goal = self._asked.goal
        if not isinstance(goal, ToPose) or goal.heading is None:
            return True
        return self._print.fits(Pose(*goal.at, goal.heading), MARGIN_M / 2)

    def _with_room(self, goals: set[int]) -> Way | None:
        """Return a way on which the base may turn everywhere; None if there is none."""
        if not self._roomy.flat[self._start] or not _any(region(self._roomy, self._start), goals):
            return None
        cells = self._search(self._roomy.astype(np.uint8).tobytes(), goals)
        return self._way(self._pulled(cells, self._roomy))

    def _as_it_fits(self, cost: Costs, goals: set[int]) -> Answer:
        stuck: Pose | None = None
        ends_s = time.thread_time() + _MOST_S
        while time.thread_time() < ends_s:
            way = self._way(self._pulled(self._search(cost.tobytes(), goals), cost > 0))
            if way is None or (stuck := self._stuck(way.poses)) is None:
                return way or Blocked("between", ())
            if not self._shut(cost, stuck, goals):
                return Blocked("start" if self._is_start(stuck) else "goal", self._near(stuck))
            if (apart := self._apart_from(goals, cost)) is not None:
                return Blocked("between", apart.by)
        return Blocked("between", () if stuck is None else self._near(stuck))

    def _open_around_start(self, cost: Costs) -> None:
        """Let a base that stands nearer to something than its margin leave that."""
        kept_m = self._print.kept(self._asked.start)
        if kept_m < MARGIN_M:
            x, y = self._lattice.point(self._start)
            window = self._lattice.window(np.array((x, y)) - 0.5, np.array((x, y)) + 0.5)
            free = self._grid.clearance_m[window] >= self._print.inner
            cost[window] = np.where(free & (cost[window] == 0), _TIGHT_COST, cost[window])
            cost[[0, -1], :] = cost[:, [0, -1]] = 0

    def _search(self, cost: bytes, goals: set[int]) -> list[int]:
        return search(cost, self._lattice.columns, self._start, goals, self._estimate(goals))

    def _estimate(self, goals: set[int]) -> list[int]:
        """Return the least cost from each cell to the rectangle around the goals."""
        rows, columns = np.divmod(np.fromiter(goals, np.intp, len(goals)), self._lattice.columns)
        down, across = _beyond(self._lattice.rows, rows)[:, None], _beyond(self._lattice.columns, columns)[None, :]
        least = STRAIGHT * np.maximum(down, across) + (DIAGONAL - STRAIGHT) * np.minimum(down, across)
        found: list[int] = least.ravel().tolist()
        return found

    def _pulled(self, cells: Sequence[int], free: Bools) -> list[Point]:
        """Return the corners of a way after which it is straight, from the start."""
        points = [(self._asked.start.x, self._asked.start.y), *(self._lattice.point(each) for each in cells[1:])]
        if isinstance(self._asked.goal, ToPose):
            points[-1:] = [self._asked.goal.at] if len(points) > 1 else [points[0], self._asked.goal.at]
        found, anchor = [points[0]], 0
        for index in range(2, len(points)):
            if not self._sees(points[anchor], points[index], free):
                anchor = index - 1
                found.append(points[anchor])
        return [*found, points[-1]]

    def _sees(self, start: Point, end: Point, free: Bools) -> bool:
        count = max(2, math.ceil(2 * math.dist(start, end) / self._lattice.step_m))
        shares = np.linspace(0.0, 1.0, count)[:, None]
        points = np.asarray(start) + shares * (np.asarray(end) - start)
        columns, rows = np.rint((points - self._lattice.origin) / self._lattice.step_m).astype(int).T
        return bool(free[rows, columns].all())

    def _way(self, corners: Sequence[Point]) -> Way | None:
        """Return the way through corners; None if it has too many."""
        poses = []
        for start, end in pairwise(corners):
            if math.dist(start, end) > 1e-6:
                poses.append(Pose(*end, math.atan2(end[1] - start[1], end[0] - start[0])))
        last = poses[-1] if poses else self._asked.start
        if poses or not isinstance(self._asked.goal, AsideOf):
            poses = [*poses[:-1], last._replace(heading=self._last_heading(last))]
        length_m = sum(math.dist(*leg) for leg in pairwise(corners))
        return Way(tuple(poses), length_m) if len(poses) <= MOST_POSES else None

    def _last_heading(self, last: Pose) -> float:
        goal = self._asked.goal
        if isinstance(goal, Near):
            return math.atan2(goal.at[1] - last.y, goal.at[0] - last.x)
        heading = goal.heading if isinstance(goal, ToPose) else None
        return last.heading if heading is None else heading

    # -- what is in the way -----------------------------------------------------------------------------------------

    def _stuck(self, way: Sequence[Pose]) -> Pose | None:
        """Return the first pose of a way at which the base meets something."""
        kept_m = min(self._print.kept(self._asked.start) - 0.002, MARGIN_M / 2)
        return next((pose for pose in self._tight(way, kept_m) if not self._print.fits(pose, kept_m)), None)

    def _tight(self, way: Sequence[Pose], kept_m: float) -> Iterator[Pose]:
        """Yield the poses of a way at which something may be nearer to the base than a distance, by the grid."""
        room_m = self._print.radius + kept_m + self._lattice.step_m
        clearance_m, cell = self._grid.clearance_m.flat, self._lattice.cell
        return (pose for pose in self._poses(way) if clearance_m[cell((pose.x, pose.y))] < room_m)

    def _poses(self, way: Sequence[Pose]) -> Iterator[Pose]:
        """Yield the poses of a way a few centimetres and degrees apart."""
        start = self._asked.start
        for one, other in pairwise((start, *through(start, way, self._asked.lateral))):
            yield from _between(one, other)

    def _shut(self, cost: Costs, stuck: Pose, goals: set[int]) -> bool:
        """Shut the cells around a pose. Return False if that is the start or the goal."""
        at = (stuck.x, stuck.y)
        if self._is_start(stuck) or (len(goals) == 1 and self._lattice.cell(at) in goals):
            return False
        window = self._lattice.window(np.array(at) - _SHUT_M, np.array(at) + _SHUT_M)
        held = cost.flat[self._start]
        cost[window] = 0
        cost.flat[self._start] = held
        return True

    def _is_start(self, pose: Pose) -> bool:
        return math.dist(pose[:2], self._asked.start[:2]) < self._lattice.step_m

    def _apart_from(self, goals: set[int], cost: Costs) -> Blocked | None:
        """Return what is around the start or the goal, whichever has less floor; None if one is reached from the other.

        The way is blocked "between" them if both have more than a few cells.
        """
        free = cost > 0
        reached = region(free, self._start)
        if _any(reached, goals):
            return None
        if len(goals) == 1:
            (goal,) = goals
            if not free.flat[goal]:
                return Blocked("goal", self._around_goal())
            beyond = region(free, goal)
            if beyond.sum() <= reached.sum():
                return Blocked("goal" if beyond.sum() <= _MOST_POCKET else "between", self._border(beyond, free))
        return Blocked("start" if reached.sum() <= _MOST_POCKET else "between", self._border(reached, free))

    def _around_goal(self) -> tuple[str, ...]:
        goal = self._asked.goal
        return () if isinstance(goal, AsideOf) else self._near(Pose(*goal.at))

    def _near(self, pose: Pose) -> tuple[str, ...]:
        """Return the name of what is the nearest to a pose."""
        number = int(self._grid.nearest.flat[self._lattice.cell((pose.x, pose.y))])
        return () if number == NOTHING else (self._names[number],)

    def _border(self, reached: Bools, free: Bools) -> tuple[str, ...]:
        """Return the names of the obstacles around the cells that were reached, the most frequent first."""
        beside = np.zeros_like(reached)
        for axis in (0, 1):
            for step in (1, -1):
                beside |= np.roll(reached, step, axis)
        numbers = self._grid.nearest[beside & ~free]
        found, counts = np.unique(numbers[numbers != NOTHING], return_counts=True)
        return tuple(self._names[each] for each in found[np.argsort(-counts)][:_MOST_NAMES].tolist())


def _any(cells: Bools, goals: set[int]) -> bool:
    return bool(cells.flat[np.fromiter(goals, np.intp, len(goals))].any())


def _beyond(count: int, taken: npt.NDArray[np.intp]) -> npt.NDArray[np.intp]:
    """Return how far each of the first numbers is from the least to the greatest of some."""
    numbers = np.arange(count)
    found: npt.NDArray[np.intp] = np.maximum(0, np.maximum(taken.min() - numbers, numbers - taken.max()))
    return found


def _between(start: Pose, end: Pose) -> Iterator[Pose]:
    """Yield poses from one to another, without the first."""
    count = max(1, math.ceil(math.dist(start[:2], end[:2]) / 0.04), math.ceil(abs(end.heading - start.heading) / 0.08))
    for index in range(1, count + 1):
        yield start.between(end, index / count)
