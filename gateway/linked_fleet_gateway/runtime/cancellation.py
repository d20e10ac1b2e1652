"""Ending tasks for certain."""

import asyncio
from collections.abc import Iterable

_PAUSE_S = 0.1


async def end(tasks: Iterable[asyncio.Task[None]]) -> None:
    """Cancel tasks until all of them are done.

    Once is not enough: a request to Redis or to a receiver that ends at the moment of the cancellation can swallow it,
    and who works in a loop goes on. Unlike the tasks this is interrupted when its own caller is cancelled.
    """
    pending = {task for task in tasks if not task.done()}
    while pending:
        for task in pending:
            task.cancel()
        _, pending = await asyncio.wait(pending, timeout=_PAUSE_S)
