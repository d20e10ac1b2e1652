"""Child processes: replaced when they die, reliably ended, and without data that they do not need."""

import signal
from asyncio.subprocess import PIPE
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path

import pytest

from linked_fleet_gateway.runtime.worker import Worker

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
async def started() -> AsyncIterator[Worker]:
    worker = Worker("child_of_test", {"OWN": "own"})
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
