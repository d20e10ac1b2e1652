"""Long work on the event loop in slices of a few milliseconds."""

import asyncio
import time
from collections.abc import AsyncIterator, Iterable
from typing import TypeVar

_T = TypeVar("_T")
SLICE_S = 0.002


async def sliced(items: Iterable[_T]) -> AsyncIterator[_T]:
    """Yield the items, giving other tasks a turn whenever ``SLICE_S`` has passed."""
    until_s = time.monotonic() + SLICE_S
    for item in items:
        yield item
        if time.monotonic() > until_s:
            await asyncio.sleep(0)
            until_s = time.monotonic() + SLICE_S
