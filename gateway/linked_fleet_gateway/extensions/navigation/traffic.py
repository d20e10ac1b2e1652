"""Drives to a goal, and who gives way. Metre, radian, second.

The rule: of two drives that need the same floor, that of a person goes before that of a program, and else the one that
was asked for first. The other one waits where it is and, if it stands in the way, drives aside; if it cannot, the first
one does. A base that has begun to drive has the floor up to the end of its way, and nobody else is sent there. Robots
that are not on such a drive are obstacles, and those among them that move are waited for.
"""

import asyncio
from collections.abc import Awaitable, Callable, Iterable, Sequence
from contextlib import suppress
from dataclasses import replace
from zlib import crc32

from msgspec import structs

from linked_fleet_gateway.extensions.navigation.messages import (
    Answer,
    AsideOf,
    Blocked,
    Obstacle,
    PlanFailed,
    PlanWay,
    Polygon,
    TooFar,
    Way,
)
from linked_fleet_gateway.extensions.navigation.other_gateways import Board, Others
from linked_fleet_gateway.extensions.navigation.swept import meets, swept
from linked_fleet_gateway.extensions.navigation.trips import (
    Around,
    Aside,
    Ask,
    DriveError,
    Ended,
    NoWayError,
    Trip,
    UnplannedError,
    goes_first,
    known_name,
)

PATIENCE_S, LONGEST_WAIT_S = 30.0, 600.0
"""Time that a drive waits for what stands in its way, and for robots that will leave."""
LOOK_S = 0.5
_MOST_LOST = 3
Plan = Callable[[PlanWay], Awaitable[Answer]]


class Traffic:
    """The drives of a gateway.

    ``is_driven`` tells if a robot is on such a drive at any gateway, ``title`` what an obstacle is called. By ``board``
    it hears of the drives of other gateways.
    """

    def __init__(
        self,
        plan: Plan,
        is_driven: Callable[[str], bool] = lambda name: False,
        title: Callable[[str], str] = str,
        board: Board | None = None,
    ) -> None:
        self._plan, self._is_driven, self._title = plan, is_driven, title
        self._trips, self._others = dict[str, Trip](), Others(board, is_driven)
        self._first = dict[str, tuple[PlanWay, Answer]]()
        """By robot, what was asked for its next drive, and the answer."""
        self._changed = asyncio.Event()

    async def first_way(self, trip: Trip) -> Way | None:
        """Return the way of a new drive; None if it has to wait for other robots first.

        Raises NoWayError, UnplannedError.
        """
        around = await self._around(trip)
        answer = await self._ask(trip, around, around.obstacles)
        if isinstance(answer, Way):
            self._first[trip.name] = _question(trip, around, around.obstacles), answer
            return answer
        alone = await self._ask(trip, around, self._lasting(around))
        if isinstance(alone, Way):
            return None
        if isinstance(alone, PlanFailed):
            raise UnplannedError(self.in_words(alone))
        raise NoWayError(self.in_words(alone), alone.by if isinstance(alone, Blocked) else ())

    async def run(self, trip: Trip) -> None:
        """Drive to the goal. Raises DriveError."""
        if trip.name in self._trips:
            raise DriveError(f"{trip.name} is on another drive of this kind")
        self._trips[trip.name] = trip
        try:
            await self._run(trip)
        finally:
            trip.ended = True
            del self._trips[trip.name]
            self.tell()
            await self._others.tell(trip)

    async def _run(self, trip: Trip) -> None:
        clock, times_lost = asyncio.get_running_loop(), 0
        begun_s = clock.time()
        while True:
            await self._give_way(trip)
            found = await self._await_way(trip)
            if found is None:
                continue
            ended = await self._drive(trip, *found)
            if ended.arrived:
                return
            begun_s, times_lost = begun_s if ended.refused else clock.time(), times_lost + bool(ended.lost)
            why = ended.failed or ended.lost or ended.refused
            if ended.failed or times_lost > _MOST_LOST or clock.time() - begun_s > PATIENCE_S:
                raise DriveError(why)
            trip.report(ended.blocked or why)
            await self._pause(trip)

    async def _drive(self, trip: Trip, around: Around, way: Way) -> Ended:
        trip.way = _floor(around, way)
        trip.helpless.clear()
        trip.asks.clear()
        self.tell()
        await self._others.tell(trip)
        try:
            return await trip.base.follow(way)
        finally:
            trip.way = ()
            self.tell()

    # -- the way ----------------------------------------------------------------------------------------------------

    async def _await_way(self, trip: Trip) -> tuple[Around, Way] | None:
        """Return the way once nobody is on it, with what is around; None if asked to give way. Raises NoWayError."""
        clock = asyncio.get_running_loop()
        began_s = clock.time()
        while trip.aside is None:
            found, why = await self._way(trip)
            if found is not None:
                trip.waits_for = ()
                trip.report("")
                return found
            trip.report(why)
            if clock.time() - began_s > (LONGEST_WAIT_S if trip.waits_for else PATIENCE_S):
                raise NoWayError(why)
            await self._wait(trip)
        return None

    async def _way(self, trip: Trip) -> tuple[tuple[Around, Way] | None, str]:
        """Return the way if nobody is on it; else None, and what the drive waits for."""
        try:
            around = await self._around(trip)
        except UnplannedError as error:
            return None, str(error)
        answer = await self._ask(trip, around, around.obstacles)
        if isinstance(answer, Way):
            return (around, answer), ""
        alone = await self._ask(trip, around, self._lasting(around))
        if not isinstance(alone, Way):
            trip.waits_for = ()
            return None, self.in_words(alone)
        floor = _floor(around, alone)
        on_it = self._on(around, floor)
        trip.asks.clear()
        for name in on_it:
            self._ask_aside(trip, name, floor)
        trip.waits_for = on_it
        return None, f"waits for {' and '.join(map(self._title, on_it)) or 'other robots'}"

    def _on(self, around: Around, floor: Sequence[Polygon]) -> tuple[str, ...]:
        """Return the robots on a floor that will leave it."""
        lasting = self._lasting(around)
        leaving = (each for each in around.obstacles if each not in lasting)
        return tuple(dict.fromkeys(each.name for each in leaving if _is_on(each, floor)))

    def _lasting(self, around: Around) -> list[Obstacle]:
        """Return the obstacles except robots that move or are on a drive."""
        moving = {each.name for each in around.obstacles if each.passes}
        return [
            each
            for each in around.obstacles
            if each.name not in moving and each.name not in self._trips and not self._is_driven(each.name)
        ]

    # -- giving way -------------------------------------------------------------------------------------------------

    def _ask_aside(self, trip: Trip, name: str, floor: tuple[Polygon, ...]) -> None:
        """Ask the drive of a robot that waits to leave the floor, if it has to."""
        other = self._trip(name)
        if other is None or other.driving or not goes_first(trip, other):
            return
        if name not in self._trips:
            trip.asks[name] = Ask(trip.name, floor)
            return
        held = other.aside
        if held is None or held.is_over or (held.asker is not trip and trip.rank < held.asker.rank):
            other.aside = Aside(trip, floor)
            self.tell()

    def _take(self, trip: Trip, asker: Trip, ask: Ask) -> None:
        """Let a drive of this gateway give way, as another gateway asks for."""
        held = trip.aside
        if trip.driving or asker.driving or not (ask.passed_on or goes_first(asker, trip)):
            return
        if held is None or held.is_over:
            is_news = asker not in trip.helpless
        else:
            is_news = held.floor != ask.floor if held.asker is asker else asker.rank < held.asker.rank
        if is_news:
            trip.aside = Aside(asker, ask.floor)
            self.tell()

    def _trip(self, name: str) -> Trip | None:
        """Return the drive of a robot, at this gateway or another one."""
        return self._trips.get(name) or self._others.get(name)

    async def _give_way(self, trip: Trip) -> None:
        """Leave the floor that another drive needs, until that is on its way or has ended. Raises DriveError."""
        while (aside := trip.aside) is not None:
            if aside.is_over:
                trip.aside = None
                trip.asks.clear()
            elif aside.done:
                await self._wait(trip)
            else:
                trip.report(f"gives way to {self._title(known_name(trip, aside.asker))}")
                try:
                    await self._leave(trip, aside)
                except UnplannedError as error:
                    trip.report(str(error))
                    await self._wait(trip)

    async def _leave(self, trip: Trip, aside: Aside) -> None:
        """Drive off a floor, or make those ask who are in the way of that. Give up if nothing helps."""
        around, off = await self._around(trip), replace(trip, goal=AsideOf(aside.floor), corridor=())
        answer = await self._ask(off, around, around.obstacles)
        if isinstance(answer, Way):
            ended = await self._drive_aside(trip, around, answer)
            aside.done = ended.arrived
            return
        alone = await self._ask(off, around, self._lasting(around))
        on_it = self._on(around, _floor(around, alone)) if isinstance(alone, Way) else ()
        if isinstance(alone, Way) and self._pass_on(trip, aside, on_it, _floor(around, alone)):
            await self._wait(trip)
        else:
            trip.helpless.add(aside.asker)
            trip.aside = None
            self.tell()

    def _pass_on(self, trip: Trip, aside: Aside, on_it: Iterable[str], floor: tuple[Polygon, ...]) -> bool:
        """Ask those who keep a drive from giving way to leave too. Return False if one of them cannot."""
        whole = (*aside.floor, *floor)
        for name in on_it:
            other = self._trip(name)
            if other is aside.asker or (other is not None and aside.asker in other.helpless):
                return False
            if other is not None and name not in self._trips:
                trip.asks[name] = Ask(aside.asker.name, whole, passed_on=True)
            elif other is not None and not other.driving and (other.aside is None or other.aside.is_over):
                other.aside = Aside(aside.asker, whole)
        self.tell()
        return True

    async def _drive_aside(self, trip: Trip, around: Around, way: Way) -> Ended:
        if not way.poses:
            return Ended(arrived=True)
        ended = await self._drive(trip, around, way)
        if ended.failed:
            raise DriveError(ended.failed)
        if not ended.arrived:
            await self._pause(trip)
        return ended

    async def _around(self, trip: Trip) -> Around:
        """Return what is around a base, with the ways of other drives that nobody else knows of yet."""
        around = await trip.base.around()
        known = {each.name for each in around.obstacles if each.passes}
        ways = [
            Obstacle(known_name(trip, each), each.way, passes=True)
            for each in self._trips.values()
            if each is not trip and each.driving and each.name not in known
        ]
        return structs.replace(around, obstacles=(*around.obstacles, *ways))

    # -- helpers ----------------------------------------------------------------------------------------------------

    async def _ask(self, trip: Trip, around: Around, obstacles: Sequence[Obstacle]) -> Answer:
        asked = _question(trip, around, obstacles)
        before, answer = self._first.pop(trip.name, (None, None))
        return await self._plan(asked) if answer is None or asked != before else answer

    def in_words(self, answer: Answer) -> str:
        """Return why there is no way."""
        match answer:
            case Blocked(place, by):
                what = " and ".join(map(self._title, by)) or "what is around it"
                return {
                    "start": f"the base cannot leave its place because of {what}",
                    "goal": f"the goal cannot be reached because of {what}",
                    "between": f"no way leads to the goal because of {what}",
                }[place]
            case TooFar(most_m):
                return f"the goal is further than {most_m:g} m, or the way to it has too many corners"
            case PlanFailed(reason):
                return f"no way could be planned: {reason}"
        raise AssertionError(answer)

    def tell(self) -> None:
        """Wake the drives that wait, because another one has changed."""
        self._changed.set()
        self._changed = asyncio.Event()

    async def _wait(self, trip: Trip) -> None:
        """Wait until another drive has changed, but not long. Exchange with other gateways what drives ask for."""
        changed = self._changed
        await self._others.tell(trip)
        with suppress(TimeoutError):
            async with asyncio.timeout(LOOK_S):
                await changed.wait()
        self._hear()

    async def _pause(self, trip: Trip) -> None:
        """Wait before another attempt; each base for another time, lest two of them refuse each other again."""
        await self._others.tell(trip)
        await asyncio.sleep(LOOK_S * (1.0 + crc32(trip.name.encode()) % 16 / 16))
        self._hear()

    def _hear(self) -> None:
        for asked, asker, ask in self._others.hear(self._trips):
            self._take(asked, asker, ask)


def _question(trip: Trip, around: Around, obstacles: Sequence[Obstacle]) -> PlanWay:
    others = tuple(each for each in obstacles if each.name != trip.name)
    return PlanWay(around.pose, trip.goal, around.outline, others, around.cells, trip.corridor, around.lateral)


def _floor(around: Around, way: Way) -> tuple[Polygon, ...]:
    return tuple(swept(around.outline, around.pose, way.poses, around.lateral))


def _is_on(obstacle: Obstacle, floor: Sequence[Polygon]) -> bool:
    return any(meets(one, other) for one in obstacle.polygons for other in floor)
