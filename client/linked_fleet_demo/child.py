"""A process of the demo's tree: it ends with the demo, even if the demo is killed."""

import ctypes
import os
import re
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import IO

SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
# Log lines that a demonstration does not need.
_CHATTER = re.compile(r"\S+ \S+ (DEBUG |INFO )")
_PDEATHSIG = 1  # PR_SET_PDEATHSIG of Linux's prctl
_OTHER_FLEETS = ("LINKED_FLEET_", "REDIS_")


class Child:
    """A process of the tree. Its output, from warnings upward, is printed line by line with its name.

    It gets none of the settings of other fleets in the environment, but those in ``environment``.
    """

    def __init__(self, name: str, module: str, arguments: Sequence[str], environment: Mapping[str, str]) -> None:
        self.name = name
        self.command = [sys.executable, "-m", module, *arguments]
        self.told_to_end = False  # from then on only its exit code is reported
        own = {key: value for key, value in os.environ.items() if not key.startswith(_OTHER_FLEETS)}
        self.process = subprocess.Popen(  # noqa: S603 our own modules, no shell
            self.command,
            env={**own, **environment},
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            errors="replace",
            preexec_fn=_preparation(),
        )
        assert self.process.stdout is not None
        self._reader = threading.Thread(target=self._pass_on, args=(self.process.stdout,), daemon=True)
        self._reader.start()

    def _pass_on(self, lines: IO[str]) -> None:
        with lines:
            for line in lines:
                if not (self.told_to_end or _CHATTER.match(line)):
                    print_line(f"{self.name:>7} | {line.rstrip()}")

    def end(self) -> None:
        self.told_to_end = True
        self.process.terminate()

    def wait(self, deadline: float) -> bool:
        """Return True if the process has ended and its output is printed before ``deadline``."""
        try:
            self.process.wait(max(0.0, deadline - time.monotonic()))
        except subprocess.TimeoutExpired:
            return False
        self._reader.join(0.2)
        return True


def _preparation() -> Callable[[], None]:
    """Return the function that a child runs before its program. Symbols are looked up here, before the fork."""
    prctl = ctypes.CDLL(None).prctl if sys.platform == "linux" else None
    parent = os.getpid()

    def prepare() -> None:
        # Ctrl-C reaches the whole process group and would end a loading child with a traceback. The demo handles it and
        # sends SIGTERM to its children.
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        # An inherited handler would run here, before the program.
        for number in (signal.SIGTERM, signal.SIGHUP):
            signal.signal(number, signal.SIG_DFL)
        signal.pthread_sigmask(signal.SIG_UNBLOCK, SIGNALS)  # blocked by the parent during the start
        if prctl is not None:  # the kernel ends the child when the demo is killed
            prctl(_PDEATHSIG, signal.SIGTERM, 0, 0, 0)
            if os.getppid() != parent:
                os.kill(os.getpid(), signal.SIGTERM)

    return prepare


def print_line(text: str) -> None:
    try:
        print(f"{text}\n", end="", flush=True)  # in one piece: children are read in threads
    except OSError:  # the terminal is closed; the fleet runs on until a signal ends it
        sys.stdout = Path(os.devnull).open("w")  # noqa: SIM115


@contextmanager
def signals_held_back() -> Iterator[None]:
    signal.pthread_sigmask(signal.SIG_BLOCK, SIGNALS)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_UNBLOCK, SIGNALS)
