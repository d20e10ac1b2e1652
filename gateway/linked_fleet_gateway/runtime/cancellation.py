"""Reliable cancellation of tasks."""

import asyncio
from collections.abc import Iterable

_PAUSE_S = 0.1


async def end(tasks: Iterable[asyncio.Task[None]]) -> None:
    """Cancel tasks until all of them are done.

    Once is not enough: a request that completes at the moment of cancellation can swallow it, and a loop then
    continues. Unlike the tasks, this call is interrupted when its own caller is cancelled.
    """
    pending = {task for task in tasks if not task.done()}
    while pending:
        for task in pending:
            task.cancel()
        _, pending = await asyncio.wait(pending, timeout=_PAUSE_S)
