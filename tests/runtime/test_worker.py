"""Child processes: replaced when they die, reliably ended, and without data that they do not need."""

import asyncio
import signal
from asyncio.subprocess import PIPE
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path

import pytest

from linked_fleet_runtime.worker import Worker

CHILD = """
import os, sys
print(sys.argv[1], os.environ.get("OWN"), os.environ.get("SECRET"), os.getsid(0) == os.getpid(), flush=True)
sys.stdin.read()
"""


@pytest.fixture(autouse=True)
def _environment(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "child_of_test.py").write_text(CHILD)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    monkeypatch.setenv("SECRET", "of the gateway")


@asynccontextmanager
async def started(idle_s: float = 3600.0) -> AsyncIterator[Worker]:
    worker = Worker("child_of_test", {"OWN": "own"}, idle_s=idle_s)
    try:
        yield worker
    finally:
        await worker.end()


async def said(worker: Worker, word: str) -> bytes:
    process = await worker.start(word, stdin=PIPE, stdout=PIPE)
    assert process.stdout is not None
    return await process.stdout.readline()


async def test_a_worker_gets_arguments_a_limited_environment_and_its_own_session() -> None:
    async with started() as worker:
        assert not worker.running
        assert await said(worker, "word") == b"word own None True\n"
        assert worker.running


async def test_a_frozen_worker_is_killed_and_replaced() -> None:
    async with started() as worker:
        await said(worker, "first")
        first = worker.process
        first.send_signal(signal.SIGSTOP)
        assert (await said(worker, "second")).startswith(b"second")
        assert first.returncode == -signal.SIGKILL and worker.running
        worker.process.kill()
        await worker.process.wait()
        assert not worker.running
        await worker.end()
        await worker.end()  # nothing to do


async def test_an_idle_worker_ends_and_can_be_started_again() -> None:
    async with started(idle_s=0.0) as worker:
        for word in ("first", "second"):
            with worker.in_use():
                assert (await said(worker, word)).startswith(word.encode())
                process = worker.process
            assert await process.wait() == -signal.SIGKILL
            assert not worker.running


async def test_a_worker_is_kept_until_the_last_of_overlapping_uses_ends() -> None:
    async with started(idle_s=0.0) as worker:
        with worker.in_use():
            await said(worker, "word")
            process = worker.process
            with worker.in_use():
                pass
            await _turns_of_the_loop()
            assert worker.running
        await process.wait()


async def test_a_use_that_begins_when_a_worker_becomes_idle_keeps_it() -> None:
    async with started() as worker:
        with worker.in_use():
            await said(worker, "word")
        worker._become_idle()  # by its timer
        with worker.in_use():
            await _turns_of_the_loop()
            assert worker.running


async def test_the_owner_ends_what_it_has_beside_an_idle_worker() -> None:
    ended = asyncio.Event()

    async def end() -> None:
        await worker.end()
        ended.set()

    worker = Worker("child_of_test", idle_s=0.0, on_idle=end)
    with worker.in_use():
        await said(worker, "word")
    await ended.wait()
    assert not worker.running


async def _turns_of_the_loop() -> None:
    """Let timers that are due run, and the tasks that they start."""
    for _ in range(5):
        await asyncio.sleep(0)
