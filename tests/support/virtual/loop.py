"""An event loop on virtual time: if nothing is ready, it advances the clock to the next timer instead of waiting.

A test drives it from outside by synchronous calls: ``run_until``, ``run_for`` and ``time.sleep``. Between two calls
nothing happens. Work for threads is done inline. Only while a real file descriptor is awaited, as of a child process,
does the loop wait in real time; its clock then stands still.
"""

import asyncio
import gc
import heapq
import random
import selectors
from collections.abc import Callable, Coroutine, Iterator
from contextlib import contextmanager
from typing import Any, TypeVar
from unittest import mock

from greenlet import getcurrent, greenlet

from virtual.clock import Clock
from virtual.confined import Confined, Handle, TimerHandle
from virtual.tcp import Internet, Listener

T = TypeVar("T")
PATIENCE_S = 60.0
_REAL_PATIENCE_S = 30.0
_WHOLE_S = 3600.0


class NothingHappens(AssertionError):  # noqa: N818 - an outcome of a test
    """No timer, callback or file descriptor is left that could make the condition true."""


class _Selector(selectors.DefaultSelector):
    """Advances the clock where another selector would wait."""

    loop: "VirtualLoop"

    def select(self, timeout: float | None = None) -> list[tuple[selectors.SelectorKey, int]]:
        if self.loop.look():
            return []
        others = len(self.get_map()) - 1  # besides the loop's own pipe
        exiting = self.loop.awaits_child()
        if timeout is not None and timeout <= 0:
            if not self.loop._ready:  # type: ignore[attr-defined]
                # a timer is due that asyncio does not see yet, because floats are coarse at late times
                self.loop.advance(0)
            return super().select(0) if others or exiting else []
        if others > self.loop.idle_pipes() or exiting:
            found = super().select(_REAL_PATIENCE_S)
            if not found:
                raise NothingHappens(f"a child process did not answer within {_REAL_PATIENCE_S} s of real time")
            return found
        self.loop.advance(timeout)
        return []


def _is_open(pipe: Any) -> bool:
    return pipe is not None and not pipe.is_closing()


class VirtualLoop(asyncio.SelectorEventLoop):
    """The loop, its ``clock`` and its ``internet``, in which all TCP connections are made."""

    def __init__(self, seed: int = 0) -> None:
        self.seed = seed
        self.clock = Clock()
        self.internet = Internet(self)
        self.world: Any = None
        """The ``virtual.processes.World`` of the loop, kept here so that it ends with the loop."""
        self.confined = list[Confined]()
        self._condition: Callable[[], object] | None = None
        self._main = getcurrent()
        self._workers: dict[greenlet, Callable[[], object]] = {}
        selector = _Selector()
        selector.loop = self
        super().__init__(selector)
        self._children = list[Any]()
        self._failures: list[dict[str, Any]] = []
        self.set_exception_handler(lambda _, context: self._failures.append(context))

    def time(self) -> float:
        return self.clock.monotonic_s

    # -- driven by a test ---------------------------------------------------------------------------------------------

    def run_until(self, condition: Callable[[], T], what: str = "the condition", within_s: float = PATIENCE_S) -> T:
        """Run until ``condition`` is true, and return its value. AssertionError after ``within_s`` of virtual time."""
        if (value := condition()) or within_s <= 0:
            return value
        end_s = self.time() + within_s
        deadline = self.call_at(end_s, lambda: None)
        self._wait(lambda: condition() or self.time() >= end_s)
        deadline.cancel()
        value = condition()
        assert value, f"never happened within {within_s} s of virtual time: {what}"
        return value

    def run_for(self, duration_s: float) -> None:
        """Let time pass, running everything that is due in it."""
        passed = list[bool]()
        self.call_later(duration_s, passed.append, True)
        self._wait(lambda: passed)

    def run(self, work: Coroutine[Any, Any, T], within_s: float = PATIENCE_S) -> T:
        """Run a coroutine to its end. TimeoutError after ``within_s`` of virtual time."""

        async def bounded() -> T:
            async with asyncio.timeout(within_s):
                return await work

        task = self.create_task(bounded())
        self._wait(task.done)
        return task.result()

    def _run_whole(self, main: Coroutine[Any, Any, T], *, debug: bool | None = None) -> T:
        """Like ``asyncio.run``, but beside everything else in the loop; tasks that ``main`` leaves continue."""
        return self.run(main, _WHOLE_S)

    def start(self, work: Callable[[], object]) -> None:
        """Begin synchronous work beside the test; it continues whenever the test waits."""
        self._workers[greenlet(work, parent=self._main)] = lambda: True

    def _wait(self, condition: Callable[[], object]) -> None:
        """Run the loop until the condition holds; in a worker, let the test continue meanwhile."""
        current = getcurrent()
        if current is not self._main:
            self._workers[current] = condition
            self._main.switch()
            return
        assert not self.is_running(), "a callback of the event loop would block it"
        self._condition = condition
        try:
            self.run_forever()
        finally:
            self._condition = None

    def inside(self, call: Callable[..., T], *arguments: object) -> T:
        """Call something that needs the running loop and does not wait."""
        if self.is_running():
            return call(*arguments)
        asyncio._set_running_loop(self)
        try:
            return call(*arguments)
        finally:
            asyncio._set_running_loop(None)

    def look(self) -> bool:
        """Resume workers whose condition holds, and stop the loop if the test's does; called in each turn.

        Returns True if something was resumed or stopped, since the next timer may be a different one.
        """
        gone_on = False
        for worker, condition in [*self._workers.items()]:
            if condition():
                gone_on = True
                del self._workers[worker]
                worker.switch()
        if self._condition is not None and self._condition():
            self._condition = None
            self.stop()
            return True
        return gone_on

    def awaits_child(self) -> bool:
        """Return True while a task waits for a child process to end, which a thread reports to the loop."""
        waiters = (waiter for child in self._children for waiter in child._exit_waiters or ())
        return any(not waiter.done() for waiter in waiters)

    def idle_pipes(self) -> int:
        """Return the number of open pipes of child processes from which nobody awaits anything."""
        count = 0
        for child in self._children:
            said = child.get_protocol()
            if said is None:  # it has ended
                continue
            for number, reader in ((1, said.stdout), (2, said.stderr)):
                count += _is_open(child.get_pipe_transport(number)) and reader._waiter is None
            stdin = child.get_pipe_transport(0)
            count += _is_open(stdin) and not stdin.get_write_buffer_size()
        return count

    def kill_child(self, module: str) -> None:
        """Kill the only child process that runs this module."""
        (one,) = (each for each in self._children if each.get_returncode() is None and module in each._proc.args)
        one.kill()

    def advance(self, by_s: float | None) -> None:
        if by_s is None:
            raise NothingHappens("nothing is scheduled, so that nothing can happen any more")
        self.clock.advance_to(self.time() + by_s)

    @contextmanager
    def in_charge(self) -> Iterator["VirtualLoop"]:
        """Be the current event loop, the one of ``asyncio.run``, and the clock of this process.

        Raises exceptions of callbacks that nobody handled.
        """
        _in_charge.append(self)
        asyncio.set_event_loop(self)
        with self.clock.patched(self.run_for), mock.patch.object(asyncio, "run", self._run_whole):
            try:
                yield self
            finally:
                self._end()
                asyncio.set_event_loop(None)
                _in_charge.pop()
        assert not self._failures, f"in callbacks: {self._failures}"

    def confine(self, name: str) -> Confined:
        """Create a part of this loop that can be stopped and killed separately."""
        self.confined.append(Confined(name))
        return self.confined[-1]

    def _end(self) -> None:
        gc.collect()  # so that unretrieved exceptions are reported for this test, not for the next
        self.set_exception_handler(lambda *_: None)  # teardown may fail
        for process in self.confined:
            process.bury()
        tasks = asyncio.all_tasks(self)
        for task in tasks:
            task.cancel()
        if tasks:
            self.run_until_complete(asyncio.gather(*tasks, return_exceptions=True))
        self.run_until_complete(self.shutdown_asyncgens())
        self.close()

    # -- as an event loop ---------------------------------------------------------------------------------------------

    def _call_soon(self, callback: Any, args: Any, context: Any) -> asyncio.Handle:
        handle = Handle(callback, args, self, context)
        self._ready.append(handle)  # type: ignore[attr-defined]
        return handle

    def call_at(self, when: float, callback: Any, *args: Any, context: Any = None) -> asyncio.TimerHandle:
        timer = TimerHandle(when, callback, args, self, context)
        heapq.heappush(self._scheduled, timer)  # type: ignore[attr-defined]
        timer._scheduled = True  # type: ignore[attr-defined]
        return timer

    def run_in_executor(self, executor: object, func: Callable[..., T], *args: object) -> "asyncio.Future[T]":
        """Call ``func`` in the next turn: threads would make the order of events random."""
        done: asyncio.Future[T] = self.create_future()

        def call() -> None:
            if done.cancelled():
                return
            try:
                done.set_result(func(*args))
            except BaseException as error:  # noqa: BLE001 - raised where it is awaited
                done.set_exception(error)

        self.call_soon(call)
        return done

    async def subprocess_exec(self, *arguments: Any, **more: Any) -> Any:
        transport, protocol = await super().subprocess_exec(*arguments, **more)
        self._children.append(transport)
        return transport, protocol

    async def create_connection(self, protocol_factory: Any, host: Any = None, port: Any = None, **more: Any) -> Any:
        return await self.internet.connect(protocol_factory, host, port)

    async def create_server(
        self, protocol_factory: Any, host: Any = None, port: Any = None, *, sock: Any = None, **more: Any
    ) -> Any:
        """Listen in memory; ``sock`` is a ``virtual.tcp.Listener``."""
        listener = sock or Listener(self.internet, host, port)
        listener.begin(protocol_factory)
        return listener

    async def getaddrinfo(self, host: Any, port: Any, **more: Any) -> Any:
        return self.internet.look_up(host, port)


_in_charge = list[VirtualLoop]()


def current() -> VirtualLoop | None:
    """Return the loop that is in charge; None if the test runs in real time."""
    return _in_charge[-1] if _in_charge else None


@contextmanager
def virtual_time(seed: int = 0) -> Iterator[VirtualLoop]:
    """Yield a loop that is in charge. Its networks and the module ``random`` are seeded with ``seed``."""
    random.seed(seed)
    with VirtualLoop(seed).in_charge() as loop:
        yield loop


def on_virtual_time(test: Callable[[], Coroutine[Any, Any, T]], within_s: float = 3600.0) -> T:
    """Run a coroutine function as a test, on virtual time."""
    with virtual_time() as loop:
        return loop.run(test(), within_s)
