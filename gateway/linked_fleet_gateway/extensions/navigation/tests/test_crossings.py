"""Bases that cross each other's ways all reach their goals, and never touch."""

import asyncio
import itertools
import math
import os
import random
from collections.abc import Sequence

import pytest
from msgspec import json

from linked_fleet_agent.planar import Pose
from linked_fleet_gateway.api import RedisUnavailable
from linked_fleet_gateway.extensions.navigation import floor_grid
from linked_fleet_gateway.extensions.navigation.messages import Answer, Obstacle, PlanWay, Polygon, ToPose, Way
from linked_fleet_gateway.extensions.navigation.other_gateways import Notice
from linked_fleet_gateway.extensions.navigation.planner import plan
from linked_fleet_gateway.extensions.navigation.swept import hull, meets, swept
from linked_fleet_gateway.extensions.navigation.traffic import Traffic
from linked_fleet_gateway.extensions.navigation.trips import Around, Base, Ended, Trip

pytestmark = pytest.mark.virtual

LONG = "LONG_TESTS" in os.environ
CROSSINGS = range(500 if LONG else 6)
OUTLINE: Polygon = ((0.3, -0.2), (0.3, 0.2), (-0.3, 0.2), (-0.3, -0.2))
SPEED_M_S, TURN_RAD_S, TICK_S = 1.5, 3.0, 0.05
SIDE_M = 7.0
MOST_S = 55.0


def placed(outline: Polygon, pose: Pose) -> Polygon:
    cosine, sine = math.cos(pose.heading), math.sin(pose.heading)
    return tuple((pose.x + x * cosine - y * sine, pose.y + x * sine + y * cosine) for x, y in outline)


def box(x: float, y: float, half: float) -> Polygon:
    return placed(((half, -half), (half, half), (-half, half), (-half, -half)), Pose(x, y, 0.0))


class Floor:
    """Walls, and bases that turn and drive straight along their ways."""

    def __init__(self, walls: Sequence[Polygon]) -> None:
        self.walls = [Obstacle(f"/wall{number}", (each,)) for number, each in enumerate(walls)]
        self.bases = dict[str, Cart]()

    def check(self) -> None:
        for one, other in itertools.combinations(self.bases.values(), 2):
            assert not meets(one.covers, other.covers), f"{one.name} at {one.pose} meets {other.name} at {other.pose}"
        for base, wall in itertools.product(self.bases.values(), self.walls):
            assert not meets(base.covers, wall.polygons[0]), f"{base.name} at {base.pose} meets {wall.name}"


class Cart(Base):
    def __init__(self, floor: Floor, name: str, pose: Pose) -> None:
        self.floor, self._name, self.pose = floor, name, pose
        self.way: tuple[Polygon, ...] = ()
        floor.bases[name] = self

    @property
    def name(self) -> str:
        return self._name

    @property
    def covers(self) -> Polygon:
        return placed(OUTLINE, self.pose)

    def may_know(self, name: str) -> bool:
        return True

    async def around(self) -> Around:
        others = [Obstacle(each.name, (each.covers,)) for each in self._others]
        ways = [Obstacle(each.name, each.way, passes=True) for each in self._others if each.way]
        return Around(self.pose, OUTLINE, (*self.floor.walls, *others, *ways))

    @property
    def _others(self) -> list["Cart"]:
        return [each for each in self.floor.bases.values() if each is not self]

    async def follow(self, way: Way) -> Ended:
        """Drive, unless the check of motions would refuse that: another base stands on the way, or will."""
        covered = tuple(swept(OUTLINE, self.pose, way.poses, lateral=False))
        taken = [polygon for each in self._others for polygon in (each.covers, *each.way)]
        if any(meets(one, other) for one, other in itertools.product(covered, taken)):
            return Ended(refused="it would meet another base")
        self.way = covered
        try:
            return await self._along(way)
        finally:
            self.way = ()

    async def _along(self, way: Way) -> Ended:
        for end in way.poses:
            if math.dist(end[:2], self.pose[:2]) > 1e-6:
                await self._turn(math.atan2(end.y - self.pose.y, end.x - self.pose.x))
                await self._go(end)
        if way.poses:
            await self._turn(way.poses[-1].heading)
        return Ended(arrived=True)

    async def _turn(self, heading: float) -> None:
        left = math.remainder(heading - self.pose.heading, math.tau)
        steps = math.ceil(abs(left) / TURN_RAD_S / TICK_S)
        for _ in range(steps):
            self.pose = self.pose._replace(heading=self.pose.heading + left / steps)
            await self._tick()

    async def _go(self, end: Pose) -> None:
        start, length_m = self.pose, math.dist(end[:2], self.pose[:2])
        steps = math.ceil(length_m / SPEED_M_S / TICK_S)
        for step in range(1, steps + 1):
            share = step / steps
            self.pose = Pose(start.x + share * (end.x - start.x), start.y + share * (end.y - start.y), start.heading)
            await self._tick()

    async def _tick(self) -> None:
        await asyncio.sleep(TICK_S)
        self.floor.check()


@pytest.fixture(autouse=True)
def _coarse(monkeypatch: pytest.MonkeyPatch) -> None:
    """Plan on a coarser grid, which takes a quarter of the time."""
    monkeypatch.setattr(floor_grid, "FINEST_M", 0.1)


async def planned(asked: PlanWay) -> Answer:
    return plan(asked)


def traffic() -> Traffic:
    return Traffic(planned)


class Board:
    """The notices of all gateways, as one of them knows them. News take a while."""

    def __init__(self, boards: list["Board"]) -> None:
        self.known, self.roads = dict[str, Notice](), Traffic(planned, lambda name: True, board=self)
        self._boards = boards
        boards.append(self)

    async def change(self, id: str, record: Notice | None) -> bool:
        await asyncio.sleep(0.005)
        said = None if record is None else json.decode(json.encode(record), type=Notice)
        for each in self._boards:
            asyncio.get_running_loop().call_later(0.005 * (each is not self), each.take, id, said)
        await asyncio.sleep(0)
        return True

    def take(self, id: str, record: Notice | None) -> None:
        self.known = {name: each for name, each in self.known.items() if name != id}
        self.known |= {} if record is None else {id: record}
        self.roads.tell()


def gateways(count: int) -> list[Traffic]:
    """Return the drives of one gateway, or of several that share a table."""
    if count == 1:
        return [traffic()]
    boards = list[Board]()
    return [Board(boards).roads for _ in range(count)]


def trip(cart: Cart, goal: Pose, rank: int = 0) -> Trip:
    return Trip(cart, ToPose(goal[:2], goal.heading), (1, rank))


def scattered(chance: random.Random, floor: Floor) -> list[Pose]:
    """Return twelve poses at which bases touch neither each other nor a wall."""
    found = list[Pose]()
    walls = [each.polygons[0] for each in floor.walls]
    while len(found) < 12:
        at = Pose(chance.uniform(0, SIDE_M), chance.uniform(0, SIDE_M), chance.uniform(-3, 3))
        is_apart = all(math.dist(at[:2], each[:2]) > 1.2 for each in found)
        if is_apart and not any(meets(box(at.x, at.y, 0.5), wall) for wall in walls):
            found.append(at)
    return found


@pytest.mark.parametrize("seed", CROSSINGS)
@pytest.mark.parametrize("gateway_count", [1, 2])
async def test_all_reach_their_goals(seed: int, gateway_count: int) -> None:
    """Two to six bases among crates drive to random goals at once; 500 times in the long tests."""
    chance = random.Random(seed)
    floor = Floor([box(chance.uniform(0, SIDE_M), chance.uniform(0, SIDE_M), 0.3) for _ in range(5)])
    places = scattered(chance, floor)
    count = chance.randint(2, 6)
    carts = [Cart(floor, f"/r{number}", places[number]) for number in range(count)]
    goals, roads = [*places[6 : 6 + count]], itertools.cycle(gateways(gateway_count))
    async with asyncio.timeout(MOST_S):
        drives = enumerate(zip(carts, goals, roads, strict=False))
        await asyncio.gather(*(each.run(trip(cart, goal, rank)) for rank, (cart, goal, each) in drives))
    for cart, goal in zip(carts, goals, strict=True):
        assert math.dist(cart.pose[:2], goal[:2]) < 0.01


CORRIDOR = (hull(((-1, 0.5), (7, 0.5), (7, 0.7), (-1, 0.7))), hull(((-1, -0.5), (7, -0.5), (7, -0.7), (-1, -0.7))))
NICHE = (
    hull(((-1, 0.5), (2.4, 0.5), (2.4, 0.7), (-1, 0.7))),
    hull(((3.6, 0.5), (7, 0.5), (7, 0.7), (3.6, 0.7))),
    hull(((2.2, 0.7), (2.4, 0.7), (2.4, 1.9), (2.2, 1.9))),
    hull(((3.6, 0.7), (3.8, 0.7), (3.8, 1.9), (3.6, 1.9))),
    hull(((2.2, 1.9), (3.8, 1.9), (3.8, 2.1), (2.2, 2.1))),
    CORRIDOR[1],
    hull(((-1.2, -0.7), (-1.0, -0.7), (-1.0, 0.7), (-1.2, 0.7))),
    hull(((7.0, -0.7), (7.2, -0.7), (7.2, 0.7), (7.0, 0.7))),
)


@pytest.mark.parametrize("gateway_count", [1, 2])
async def test_two_that_meet_in_a_corridor_with_a_niche_pass(gateway_count: int) -> None:
    floor, (roads, *more) = Floor(NICHE), gateways(gateway_count)
    one, other = Cart(floor, "/one", Pose(0.0, 0.0, 0.0)), Cart(floor, "/other", Pose(4.5, 0.0, math.pi))
    async with asyncio.timeout(MOST_S):
        await asyncio.gather(
            roads.run(trip(one, Pose(6.0, 0, 0))), (more or [roads])[0].run(trip(other, Pose(0.5, 0, math.pi), 1))
        )
    assert one.pose.x > 5.9 and other.pose.x < 0.6


async def test_a_drive_takes_the_way_that_was_planned_before_unless_something_has_changed() -> None:
    asked = list[PlanWay]()

    async def counting(question: PlanWay) -> Answer:
        asked.append(question)
        return plan(question)

    floor, roads = Floor(()), Traffic(counting)
    cart = Cart(floor, "/one", Pose())
    first = trip(cart, Pose(2.0, 0.0))
    await roads.first_way(first)
    await roads.run(first)
    assert (len(asked), cart.pose.x) == (1, pytest.approx(2.0))
    back = trip(cart, Pose())
    await roads.first_way(back)
    floor.walls.append(Obstacle("/wall", (box(1.0, 0.0, 0.3),)))
    await roads.run(back)
    assert (len(asked), cart.pose.x) == (3, pytest.approx(0.0, abs=1e-6))


class Away(Board):
    """A shared table while Redis is away."""

    async def change(self, id: str, record: Notice | None) -> bool:
        raise RedisUnavailable("Redis does not answer.")


async def test_drives_go_on_while_gateways_cannot_tell_each_other() -> None:
    floor, (one, other) = Floor(()), (Away([]).roads, Away([]).roads)
    carts = [Cart(floor, "/one", Pose()), Cart(floor, "/other", Pose(0.0, 3.0, 0.0))]
    async with asyncio.timeout(MOST_S):
        await asyncio.gather(one.run(trip(carts[0], Pose(3.0))), other.run(trip(carts[1], Pose(3.0, 3.0), 1)))
    assert [each.pose.x for each in carts] == pytest.approx([3.0, 3.0])
