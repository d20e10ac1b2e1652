"""State that gateways share through Redis: this one's copy, which is read whether or not Redis is there."""

import asyncio
from collections.abc import AsyncGenerator, Awaitable, Callable, Mapping
from contextlib import aclosing
from logging import Logger
from typing import Generic, TypeVar

from linked_fleet_gateway.runtime.background import supervised
from linked_fleet_gateway.runtime.redis import StoreUnavailable

_T = TypeVar("_T")
_Done = TypeVar("_Done")
_News = TypeVar("_News")

_PAUSE_S = 2.0  # after an unforeseen error, before everything is loaded anew


class Replica(Generic[_T]):
    """Hands values to ``take`` as they are read, None for one that is not there any more.

    Values are read one after another, so that none is taken after a newer one. ``load`` and ``read`` ask Redis; what
    they raise is raised here.
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
        """Read everything anew."""
        async with self._reading:
            found = await self._load()
            for id in {*self._ids, *found}:
                self._take(id, found.get(id))
            self._ids = set(found)

    async def refresh(self, id: str) -> None:
        """Read one value anew."""
        async with self._reading:
            value = await self._read(id)
            self._take(id, value)
            (self._ids.discard if value is None else self._ids.add)(id)

    async def write(self, id: str, step: Awaitable[_Done]) -> _Done:
        """Await a step that writes a value under a condition, and read what is there now."""
        done = await step
        await self.refresh(id)
        return done


async def follow(
    what: str,
    log: Logger,
    load: Callable[[], Awaitable[None]],
    hear: Callable[[_News], Awaitable[None]],
    news: Callable[[], AsyncGenerator[_News | None, None]],
) -> asyncio.Task[None]:
    """Load a copy, or do without for now, and start the task that keeps it up to date.

    ``news`` yields None after an outage: then everything is loaded anew. ``what`` is a plural in lines of ``log``.
    """
    whole = True
    try:
        await load()
    except StoreUnavailable as outage:  # ``news`` says so as soon as Redis is there
        log.warning("the store is away, %s are not known yet: %s", what, outage)
    except Exception:
        # The boundary: whatever is in Redis, a gateway starts and stops robots.
        log.exception("%s cannot be read; the gateway starts without them", what)
        whole = False

    async def keep_up() -> None:
        nonlocal whole
        if not whole:  # because of an unforeseen error
            await load()
        whole = False
        async with aclosing(news()) as heard:
            async for one in heard:
                try:
                    await (load() if one is None else hear(one))
                except StoreUnavailable as outage:  # None follows
                    log.debug("news of %s could not be followed up: %s", what, outage)

    return supervised(keep_up, f"follow {what}", log, f"{what} are not up to date", _PAUSE_S)
