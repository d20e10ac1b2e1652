"""Drives that other gateways carry out: what they ask for, as all gateways tell each other by a shared table."""

import logging
from collections.abc import Awaitable, Callable, Iterator, Mapping
from typing import Protocol

from msgspec import Struct

from linked_fleet_gateway.api import RedisUnavailable
from linked_fleet_gateway.extensions.navigation.messages import AsideOf, Way
from linked_fleet_gateway.extensions.navigation.trips import Around, Ask, Base, Ended, Trip

log = logging.getLogger(__name__)


class Notice(Struct, frozen=True):
    """A message of a gateway to others about a drive. ``helpless``: the robots whose drives it cannot give way to."""

    trip: str
    rank: tuple[int, int]
    driving: bool = False
    asks: dict[str, Ask] = {}
    helpless: tuple[str, ...] = ()


class Board(Protocol):
    """The notices of all gateways by robot. ``change`` returns False if another gateway was faster."""

    @property
    def known(self) -> Mapping[str, Notice]: ...

    def change(self, id: str, record: Notice | None) -> Awaitable[bool]: ...


class _Elsewhere(Base):
    """A base that another gateway drives."""

    def __init__(self, name: str) -> None:
        self._name = name

    @property
    def name(self) -> str:
        return self._name

    def may_know(self, name: str) -> bool:
        return False

    async def around(self) -> Around:
        raise NotImplementedError("another gateway drives it")

    async def follow(self, way: Way) -> Ended:
        raise NotImplementedError("another gateway drives it")


class Others:
    """The drives of other gateways. A notice counts as long as its robot ``is_driven``: gateways may die."""

    def __init__(self, board: Board | None, is_driven: Callable[[str], bool]) -> None:
        self._board, self._is_driven = board, is_driven
        self._trips = dict[str, Trip]()

    def get(self, robot: str) -> Trip | None:
        return self._trips.get(robot)

    def hear(self, own: Mapping[str, Trip]) -> Iterator[tuple[Trip, Trip, Ask]]:
        """Take on what the notices say. Yield the asked drive, the asking one, and what it asks for."""
        notices = {name: each for name, each in self._notices() if name not in own and self._is_driven(name)}
        for name in self._trips.keys() - notices.keys():
            self._trips.pop(name).ended = True
        for name, notice in notices.items():
            self._take(name, notice)
        for name, notice in notices.items():
            found = (own.get(each) or self._trips.get(each) for each in notice.helpless)
            self._trips[name].helpless = {each for each in found if each is not None}
        for notice in notices.values():
            for robot, ask in notice.asks.items():
                asked, asker = own.get(robot), own.get(ask.asker) or self._trips.get(ask.asker)
                if asked is not None and asker is not None and asker is not asked:
                    yield asked, asker, ask

    def _notices(self) -> list[tuple[str, Notice]]:
        return [] if self._board is None else list(self._board.known.items())

    def _take(self, name: str, notice: Notice) -> None:
        held = self._trips.get(name)
        if held is None or held.id != notice.trip:
            if held is not None:
                held.ended = True
            held = self._trips[name] = Trip(_Elsewhere(name), AsideOf(()), notice.rank, id=notice.trip)
        held.drives_elsewhere = notice.driving

    async def tell(self, trip: Trip) -> None:
        """Tell the other gateways of a drive, if that has changed."""
        helpless = tuple(sorted(each.name for each in trip.helpless if not each.ended))
        await self._put(
            trip, None if trip.ended else Notice(trip.id, trip.rank, trip.driving, dict(trip.asks), helpless)
        )

    async def _put(self, trip: Trip, notice: Notice | None) -> None:
        if self._board is None:
            return
        try:
            while (held := self._board.known.get(trip.name)) != notice:
                if notice is None and held is not None and held.trip != trip.id:
                    return  # that of a newer drive of the robot
                if await self._board.change(trip.name, notice):
                    return
        except RedisUnavailable as error:
            log.warning("other gateways do not hear of the drive of %s: %s", trip.name, error.detail)
