"""Real processes for tests: free ports, and conditions to wait for instead of sleeps."""

import contextlib
import itertools
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TypeVar

from state_home import state_home
from virtual.loop import current

ROOT = Path(__file__).resolve().parents[2]
PATIENCE_S = 60.0
T = TypeVar("T")


def _ports() -> Iterator[int]:
    """Yield the ports of this worker, each reused as late as possible, below the kernel's ephemeral ports.

    Nothing else takes such a port between its choice and its use, and a client that still looks for the server of an
    earlier test does not find that of another test.
    """
    worker = int(os.environ.get("PYTEST_XDIST_WORKER", "gw0").removeprefix("gw")) % _MOST_WORKERS
    begin = _FIRST_PORT + worker * _PORTS_EACH
    return itertools.cycle(begin + (os.getpid() * 97 + n) % _PORTS_EACH for n in range(_PORTS_EACH))


_FIRST_PORT, _PORTS_EACH, _MOST_WORKERS = 10_000, 5_000, 4
_next_port = _ports()


def free_port() -> int:
    loop = current()
    if loop is not None:
        return loop.internet.port("127.0.0.1")
    for port in _next_port:
        with socket.socket() as probe, contextlib.suppress(OSError):
            probe.bind(("127.0.0.1", port))
            return port
    raise AssertionError("no port is free")


def eventually(probe: Callable[[], T | None], what: str | Callable[[], str]) -> T:
    """Return the first true value of ``probe``; AssertionError naming ``what`` if there is none in time."""
    started = time.monotonic()
    deadline = started + PATIENCE_S
    while True:
        begun = time.monotonic()
        if value := probe():
            return value
        now = time.monotonic()
        assert now < deadline, f"never happened: {what if isinstance(what, str) else what()}"
        if current() is None:  # polling leaves half of the time to what it waits for
            time.sleep(min(max(0.01, now - begun), 0.1))
        else:  # on virtual time waiting costs nothing, but polling does
            time.sleep(min(max(0.01, (now - started) / 8), 1.0))


class Process:
    """A child process whose output is kept for the test report: a Python program, or one by its path."""

    def __init__(
        self, arguments: Sequence[str], program: str = "", environment: Mapping[str, str] | None = None
    ) -> None:
        self.lines: list[str] = []
        command = [program] if program else [sys.executable, "-u", "-X", "faulthandler"]
        self._child = subprocess.Popen(
            [*command, *arguments],
            cwd=ROOT,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            env={**os.environ, "PYTHONPATH": str(ROOT), "XDG_STATE_HOME": state_home(), **(environment or {})},
        )
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self) -> None:
        assert self._child.stdout is not None
        self.lines.extend(iter(self._child.stdout.readline, ""))

    @property
    def output(self) -> str:
        return "".join(self.lines)

    def said(self, text: str) -> None:
        def probe() -> bool:
            assert self._child.poll() is None or text in self.output, f"ended early:\n{self.output}"
            return text in self.output

        eventually(probe, f"{text!r} in the output:\n{self.output}")

    def ended(self) -> int:
        try:
            code = self._child.wait(PATIENCE_S)
        except subprocess.TimeoutExpired:
            self._child.send_signal(signal.SIGABRT)  # faulthandler then prints the stack of every thread
            self._child.wait(PATIENCE_S)
            self._reader.join(PATIENCE_S)
            raise AssertionError(f"it did not end:\n{self.output}") from None
        self._reader.join(PATIENCE_S)
        assert not self._reader.is_alive(), f"it ended, and a process that it started did not:\n{self.output}"
        return code

    @property
    def pid(self) -> int:
        return self._child.pid

    @property
    def mapped(self) -> str:
        """The mapped files and memory segments, as the kernel lists them."""
        return Path(f"/proc/{self._child.pid}/maps").read_text()

    def kill_child(self, module: str) -> None:
        """Kill a child process, identified by its module."""
        children = Path(f"/proc/{self._child.pid}/task/{self._child.pid}/children").read_text().split()
        (one,) = (pid for pid in children if module.encode() in Path(f"/proc/{pid}/cmdline").read_bytes())
        os.kill(int(one), signal.SIGKILL)

    def send(self, number: signal.Signals) -> None:
        self._child.send_signal(number)

    def stop(self) -> int:
        if self._child.poll() is None:
            self._child.terminate()
        try:
            return self.ended()
        finally:
            if self._child.poll() is None:
                self._child.kill()
            if not self._reader.is_alive():  # otherwise closing would wait for the reader
                assert self._child.stdout is not None
                self._child.stdout.close()


@contextlib.contextmanager
def process(*arguments: str) -> Iterator[Process]:
    """Run a child process; on virtual time, a gateway or agents in the loop of the test."""
    loop = current()
    if loop is None:
        child = Process(arguments)
    else:
        from virtual.processes import VirtualProcess  # it imports the product, which few tests need

        child = VirtualProcess(loop, arguments)
    try:
        yield child
    finally:
        child.stop()
