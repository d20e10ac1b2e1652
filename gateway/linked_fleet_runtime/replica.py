"""State that gateways share through Redis, as a local copy that stays readable during outages."""

import asyncio
from collections.abc import AsyncGenerator, Awaitable, Callable, Iterator, Mapping
from contextlib import aclosing, contextmanager
from logging import Logger
from typing import Generic, Protocol, TypeVar

from linked_fleet_base.errors import DataDamaged, RedisUnavailable
from linked_fleet_runtime.background import supervised, time_sliced

_T = TypeVar("_T")
_Done = TypeVar("_Done")
_News = TypeVar("_News")

_PAUSE_S = 2.0  # pause after an unexpected error, before everything is loaded again


class Copy(Protocol):
    """A local copy of what gateways share."""

    @property
    def is_loaded(self) -> bool:
        """True once everything was read."""

    @property
    def awaits_redis(self) -> bool:
        """True while it is open and was not read, because Redis has not answered since then."""


class Loading:
    """A ``Copy`` that knows if it was loaded, which ``loading`` notes."""

    is_loaded, awaits_redis = False, True

    @contextmanager
    def loading(self) -> Iterator[None]:
        """Note how the body ends, which loads everything."""
        try:
            yield
        except Exception as error:
            self.awaits_redis &= isinstance(error, RedisUnavailable) and not isinstance(error, DataDamaged)
            raise
        self.is_loaded, self.awaits_redis = True, False


class Copies:
    """The copies of a gateway, each with the plural noun of what it contains."""

    def __init__(self) -> None:
        self._all: list[tuple[str, Copy, bool]] = []

    def add(self, noun: str, copy: Copy, *, needed_by_motions: bool = False) -> None:
        """Add a copy. ``needed_by_motions``: whether a motion is judged by what it contains."""
        self._all.append((noun, copy, needed_by_motions))

    def awaited(self) -> str:
        """Return why a starting gateway is not ready, empty if it is.

        A copy that cannot be read is a fault, and keeps no gateway from getting ready.
        """
        nouns = [noun for noun, copy, _ in self._all if copy.awaits_redis]
        return f"not read from Redis yet: {', '.join(nouns)}" if nouns else ""

    def missed_by_motions(self) -> str:
        """Return what is not known and motions are judged by, empty if there is nothing."""
        return ", ".join(noun for noun, copy, needed in self._all if needed and not copy.is_loaded)


class Replica(Loading, Generic[_T]):
    """A local copy: passes each value to ``take`` as it is read, or None if it no longer exists.

    Values are read one at a time, so that an older value never replaces a newer one. ``load`` and ``read`` query Redis;
    their errors are raised here.
    """

    def __init__(
        self,
        load: Callable[[], Awaitable[Mapping[str, _T]]],
        read: Callable[[str], Awaitable[_T | None]],
        take: Callable[[str, _T | None], None],
    ) -> None:
        self._load, self._read, self._take = load, read, take
        self._ids: set[str] = set()
        self._reading = asyncio.Lock()

    async def load(self) -> None:
        """Read all values again, and take them in slices of the event loop: there may be thousands."""
        async with self._reading:
            with self.loading():
                found = await self._load()
                async for id in time_sliced({*self._ids, *found}):
                    self._take(id, found.get(id))
            self._ids = set(found)

    async def refresh(self, id: str) -> None:
        """Read one value again."""
        async with self._reading:
            value = await self._read(id)
            self._take(id, value)
            (self._ids.discard if value is None else self._ids.add)(id)

    async def follow(
        self, what: str, log: Logger, news: Callable[[], AsyncGenerator[str | None, None]]
    ) -> asyncio.Task[None]:
        """Load everything, tolerating an outage, and start the task that keeps the copy up to date.

        ``news`` yields ids of changed values, and None after an outage.
        """
        return await follow_changes(what, log, self.load, self.refresh, news)

    async def write(self, id: str, step: Awaitable[_Done]) -> _Done:
        """Await a step that writes a value conditionally, then read the value."""
        done = await step
        await self.refresh(id)
        return done


async def follow_changes(
    what: str,
    log: Logger,
    load: Callable[[], Awaitable[None]],
    hear: Callable[[_News], Awaitable[None]],
    news: Callable[[], AsyncGenerator[_News | None, None]],
) -> asyncio.Task[None]:
    """Load a copy, tolerating an outage, and start the task that keeps it up to date.

    ``news`` yields None after an outage; everything is then loaded again. ``what`` is a plural noun for log messages.
    """
    whole = True
    try:
        await load()
    except RedisUnavailable as outage:  # ``news`` reports when Redis is back
        log.warning("%s are not known yet: %s", what, outage)
    except Exception:
        # The boundary: whatever Redis contains, a gateway must start and stop robots.
        log.exception("%s cannot be read; the gateway starts without them", what)
        whole = False

    async def keep_up() -> None:
        nonlocal whole
        if not whole:  # after an unexpected error
            await load()
        whole = False
        async with aclosing(news()) as heard:
            async for one in heard:
                try:
                    await (load() if one is None else hear(one))
                except RedisUnavailable as outage:  # None follows
                    log.debug("news of %s could not be followed up: %s", what, outage)

    return supervised(keep_up, f"follow {what}", log, f"{what} are not up to date", _PAUSE_S)
