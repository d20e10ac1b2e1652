"""Listings of descriptions that are kept, because they take a tenth of a second for each robot.

A listing is made in steps, once for all requests that want it, and kept with its coded form while the facts that it
depends on are the same. One that is too long to keep is sent while it is made.
"""

import asyncio
from collections import OrderedDict
from collections.abc import AsyncIterator, Awaitable, Callable
from dataclasses import dataclass
from functools import partial
from typing import TypeVar

from linked_fleet_gateway.api import Content

MAX_LISTING_BYTES = 16 * 2**20
MAX_KEPT_BYTES = 64 * 2**20
_STEP_BYTES = 2**18
_T = TypeVar("_T")
InThread = Callable[[Callable[[], _T], int], Awaitable[_T]]


@dataclass(frozen=True)
class KeptListing:
    """A listing, and the value of Link."""

    content: Content
    link: str


@dataclass(frozen=True)
class LongListing:
    """The parts of a listing that is too long to keep."""

    parts: AsyncIterator[bytes]
    link: str


class KeptListings:
    """Listings by key, within MAX_KEPT_BYTES; the least recently used ones are forgotten."""

    def __init__(self, in_thread: InThread[KeptListing]) -> None:
        """Create the cache; ``in_thread`` runs a call, given the number of bytes that it works on."""
        self._in_thread = in_thread
        self._kept: OrderedDict[bytes, KeptListing] = OrderedDict()
        self._too_long: bytes | None = None
        self._turn = asyncio.Lock()

    def find(self, key: bytes) -> KeptListing | None:
        found = self._kept.get(key)
        if found is not None:
            self._kept.move_to_end(key)
        return found

    async def make(
        self,
        key: bytes,
        link: str,
        parts: Callable[[], AsyncIterator[bytes]],
        is_current: Callable[[], Awaitable[bool]],
    ) -> KeptListing | LongListing:
        """Return the listing of ``parts``, made by one request at a time, and keep it if it ``is_current`` then."""
        if key == self._too_long:
            return LongListing(parts(), link)
        async with self._turn:
            if (found := self.find(key)) is not None:
                return found
            body, rest = bytearray(), parts()
            async for part in rest:
                body += part
                if len(body) > MAX_LISTING_BYTES:
                    self._too_long = key
                    return LongListing(_chain(bytes(body), rest), link)
            made = await self._in_thread(partial(_made, bytes(body), link), len(body))
            if await is_current():
                self._keep(key, made)
            return made

    def _keep(self, key: bytes, made: KeptListing) -> None:
        self._kept[key] = made
        while sum(each.content.size for each in self._kept.values()) > MAX_KEPT_BYTES:
            self._kept.popitem(last=False)


def _made(body: bytes, link: str) -> KeptListing:
    return KeptListing(Content.of(body), link)


async def _chain(begun: bytes, rest: AsyncIterator[bytes]) -> AsyncIterator[bytes]:
    for start in range(0, len(begun), _STEP_BYTES):
        yield begun[start : start + _STEP_BYTES]
    async for part in rest:
        yield part
