"""Long work on the event loop, a few milliseconds at a time."""

import asyncio
import time
from collections.abc import AsyncIterator, Iterable
from typing import TypeVar

_T = TypeVar("_T")
SLICE_S = 0.002


async def sliced(items: Iterable[_T]) -> AsyncIterator[_T]:
    """Yield the items; the event loop serves everybody else each time that ``SLICE_S`` has gone by."""
    until_s = time.monotonic() + SLICE_S
    for item in items:
        yield item
        if time.monotonic() > until_s:
            await asyncio.sleep(0)
            until_s = time.monotonic() + SLICE_S
