"""Parts of an event loop that can be stopped and killed separately, like processes of a machine.

Everything scheduled in the context of a confined part belongs to it: its tasks, their children and their timers.
"""

import asyncio
from collections.abc import Callable
from contextvars import Context, ContextVar, copy_context
from typing import Any, TypeVar

T = TypeVar("T")


class Confined:
    """The part of a loop that stands for one process.

    ``on_kill``: callbacks that end what dies with it, such as connections. ``on_stop`` and ``on_go_on``: callbacks for
    others that notice its silence. ``wall_ahead_ns``: offset of its wall clock.
    """

    def __init__(self, name: str) -> None:
        self.name = name
        self.stopped = self.dead = False
        self.wall_ahead_ns = 0
        self.on_kill: dict[object, Callable[[], None]] = {}
        self.on_stop, self.on_go_on = list[Callable[[], None]](), list[Callable[[], None]]()
        self._waiting: list[asyncio.Handle] = []
        self._context = copy_context()
        self._context.run(_confined.set, self)

    def step_wall(self, by_s: float) -> None:
        """Step its wall clock forward or back, as an operator or NTP does on its machine."""
        self.wall_ahead_ns += round(by_s * 1e9)

    def run(self, call: Callable[..., T], *arguments: object) -> T:
        """Call in the context of this process."""
        return self._context.copy().run(call, *arguments)

    def stop(self) -> None:
        """Run nothing from now on, as after SIGSTOP; connections stay open, and incoming data waits."""
        self.stopped = True
        for note in self.on_stop:
            note()

    def go_on(self) -> None:
        """Run what has waited, as after SIGCONT."""
        self.stopped = False
        for note in self.on_go_on:
            note()
        waiting, self._waiting = self._waiting, []
        for handle in waiting:
            if not handle.cancelled():
                handle._loop.call_soon(handle._run)  # type: ignore[attr-defined]

    def kill(self) -> None:
        """Never run anything again, as after SIGKILL, and release what it held."""
        self.stopped = self.dead = True
        for end in [*self.on_kill.values()]:
            end()
        self.on_kill.clear()

    def bury(self) -> None:
        """Let the tasks of a dead process be cancelled at the end of a test; they can reach nobody."""
        if self.dead:
            self.on_go_on.clear()
            self.go_on()

    def wait(self, handle: asyncio.Handle) -> None:
        self._waiting.append(handle)


_confined: ContextVar[Confined | None] = ContextVar("confined", default=None)


def confined() -> Confined | None:
    """Return the process that is running; None for the test itself."""
    return _confined.get()


def _held_up(handle: Any) -> bool:
    context: Context = handle._context
    process = context.get(_confined)
    if process is None or not process.stopped:
        return False
    process.wait(handle)
    return True


class Handle(asyncio.Handle):
    """A callback that waits while its process is stopped."""

    def _run(self) -> None:
        if not _held_up(self):
            super()._run()  # type: ignore[misc]


class TimerHandle(asyncio.TimerHandle):
    """A timer that waits while its process is stopped."""

    def _run(self) -> None:
        if not _held_up(self):
            super()._run()  # type: ignore[misc]
