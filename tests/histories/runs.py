"""Whole runs, from a seed to a history."""

import asyncio
import random
import time
from collections.abc import Callable, Coroutine
from contextlib import AbstractAsyncContextManager
from functools import partial
from pathlib import Path
from typing import Any

import uvloop

from histories.environment import Environment, one_server, replicated
from histories.gateways import hurried, receivers
from histories.history import History
from histories.in_process import GATEWAYS, InProcess
from histories.processes import GATEWAYS as PROCESSES
from histories.processes import Processes
from histories.workload import Workload, another

MakeEnvironment = Callable[[int, random.Random], AbstractAsyncContextManager[Environment]]

_HELD_S = (0.1, 0.5, 2.5)
"""The longest is longer than gateways wait for the store."""


def on_one_server(folder: Path, seed: int, operations: int) -> History:
    """Run gateways in this process with one Valkey server, and faults on the connections to it."""
    return _run(in_process(partial(one_server, folder), seed, operations))


def on_promoted_servers(folder: Path, seed: int, operations: int) -> History:
    """Run the same with two servers, which replace each other."""
    return _run(in_process(partial(replicated, folder), seed, operations))


def of_processes(folder: Path, seed: int, operations: int) -> History:
    """Run gateways as processes, with robots at a Zenoh router, and clients over HTTP."""
    return _run(_processes(folder, seed, operations))


async def _processes(folder: Path, seed: int, operations: int) -> History:
    draws, history = random.Random(seed), History()
    async with (
        replicated(folder, PROCESSES, another(draws), _HELD_S) as environment,
        Processes(environment, history, another(draws)) as fleet,
    ):
        await Workload(fleet, environment, history, draws, operations).run()
    return history


async def in_process(
    make: MakeEnvironment, seed: int, operations: int, clock: Callable[[], int] = time.monotonic_ns
) -> History:
    """Return the history of gateways in this process in a new environment.

    ``clock``: the store's time in nanoseconds.
    """
    draws, history = random.Random(seed), History(clock)
    async with make(GATEWAYS, another(draws)) as environment:
        fleet = InProcess(environment, history, another(draws))
        with hurried(), receivers(fleet.deliveries):
            async with fleet:
                await Workload(fleet, environment, history, draws, operations).run()
    return history


def _run(main: Coroutine[Any, Any, History]) -> History:
    with asyncio.Runner(loop_factory=uvloop.new_event_loop) as runner:
        return runner.run(main)
