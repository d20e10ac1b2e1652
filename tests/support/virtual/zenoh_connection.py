"""One connection between two sessions of the in-memory Zenoh network: order, latency, loss, silence and its end."""

import asyncio
from collections import deque
from collections.abc import Callable
from contextvars import Context
from dataclasses import dataclass
from functools import partial
from random import Random
from typing import Literal, NamedTuple, Protocol

Priority = Literal["control", "heartbeat", "newest", "real time", "data", "background"]
"""``control`` is for declarations, which have their own queue as in Zenoh."""

WAITING_BYTES = 1_000_000
"""Limit of bytes that wait for a silent peer, in queues of Zenoh and TCP, before droppable messages are dropped."""
_KEEP_ALIVES = 4  # number of Zenoh's keep-alives in one lease


@dataclass
class Faults:
    """Faults of every connection of a network; ``loss``: the share of droppable messages that are lost."""

    random: Random
    latency_s: tuple[float, float]
    loss: float


class End(Protocol):
    """A session, as its connections see it."""

    lease_s: float

    def attached(self, connection: "Connection") -> None: ...

    def detached(self, connection: "Connection") -> None: ...

    def hand_over(self, deliver: Callable[[], None]) -> None: ...


class _Message(NamedTuple):
    deliver: Callable[[], None]
    size: int
    timer: asyncio.TimerHandle | None


class _Pipe:
    """The messages of one direction; only those of the same priority arrive in order."""

    def __init__(self, faults: Faults) -> None:
        self._loop, self._faults = asyncio.get_running_loop(), faults
        self._waiting: dict[Priority, deque[_Message]] = {}
        self._due_s: dict[Priority, float] = {}
        self._paused = False

    @property
    def due_s(self) -> float:
        """A time at which everything sent so far has arrived."""
        return max([self._loop.time() + self.draw_s(), *self._due_s.values()])

    def draw_s(self) -> float:
        return self._faults.random.uniform(*self._faults.latency_s)

    def put(self, priority: Priority, deliver: Callable[[], None], size: int, droppable: bool, lossy: bool) -> None:
        """Send. A ``droppable`` message is lost if too much is waiting, a ``lossy`` one also at random."""
        if lossy and self._faults.loss and self._faults.random.random() < self._faults.loss:
            return
        waiting = self._waiting.setdefault(priority, deque())
        if self._paused and droppable and sum(message.size for message in waiting) + size > WAITING_BYTES:
            return
        waiting.append(_Message(deliver, size, None if self._paused else self._schedule(priority)))

    def pause(self) -> None:
        self._paused = True
        self._cancel()

    def resume(self) -> None:
        self._paused = False
        for priority, waiting in self._waiting.items():
            self._waiting[priority] = deque(message._replace(timer=self._schedule(priority)) for message in waiting)

    def clear(self) -> None:
        self._cancel()
        self._waiting.clear()

    def _schedule(self, priority: Priority) -> asyncio.TimerHandle:
        due_s = max(self._loop.time() + self.draw_s(), self._due_s.get(priority, 0.0))
        self._due_s[priority] = due_s
        return self._loop.call_at(due_s, self._arrive, priority, context=Context())

    def _arrive(self, priority: Priority) -> None:
        # The first one: timers of the same moment may fire in any order.
        self._waiting[priority].popleft().deliver()

    def _cancel(self) -> None:
        for waiting in self._waiting.values():
            for message in waiting:
                if message.timer is not None:
                    message.timer.cancel()


class Connection:
    """Open at both ends from the beginning; ``over`` is called when it is closed at both.

    While it is cut nothing arrives, and sent messages wait, as in TCP. An end gives up after hearing nothing for the
    lease of the other end. Its timers run in an empty context: messages in transit belong to neither end.
    """

    def __init__(self, one: End, other: End, faults: Faults, over: Callable[["Connection"], None]) -> None:
        self._loop, self._faults, self._over = asyncio.get_running_loop(), faults, over
        self.ends = (one, other)
        self._open = {one: True, other: True}
        self._pipes = {one: _Pipe(faults), other: _Pipe(faults)}  # by sender
        self._leases: dict[object, asyncio.TimerHandle] = {}
        self._cuts = set[object]()
        for end in self.ends:
            end.attached(self)

    def peer(self, end: End) -> End:
        return self.ends[self.ends[0] is end]

    def send(
        self, sender: End, priority: Priority, deliver: Callable[[], None], *, size: int = 0, droppable: bool = False,
        lossy: bool = False,
    ) -> None:  # fmt: skip
        if self._open[sender]:
            self._pipes[sender].put(priority, partial(self._arrive, self.peer(sender), deliver), size, droppable, lossy)

    def _arrive(self, receiver: End, deliver: Callable[[], None]) -> None:
        receiver.hand_over(lambda: self._open[receiver] and deliver())

    def settled_s(self, receiver: End) -> float:
        """Return a time at which this end has received everything that the other end has sent so far."""
        return self._pipes[self.peer(receiver)].due_s

    def cut(self, reason: object = "partition") -> None:
        """Isolate both ends until every reason is healed; ``reason`` may be an end itself."""
        cut = bool(self._cuts)
        self._cuts.add(reason)
        if reason in self._leases:  # a stopped process notices nothing
            self._leases.pop(reason).cancel()
        if cut:
            return
        for end in self.ends:
            self._pipes[end].pause()
            if end is not reason:
                self._miss(end)

    def _miss(self, end: End) -> None:
        """Let this end give up after a lease."""
        silence_s = self._faults.random.uniform(1 - 1 / _KEEP_ALIVES, 1) * self.peer(end).lease_s
        self._leases[end] = self._loop.call_later(silence_s, self._expire, end, context=Context())

    def heal(self, reason: object = "partition") -> None:
        if reason not in self._cuts:
            return
        self._cuts.discard(reason)
        if self._cuts:
            for end in self.ends:
                if end is reason and self._open[end]:
                    self._miss(end)
            return
        self._end_leases()
        for pipe in self._pipes.values():
            pipe.resume()
        for end in self.ends:
            if not self._open[end]:
                self._hang_up(end)

    def close(self, end: End) -> None:
        """Close at one end; the other end learns of it after everything sent before."""
        if self._open[end]:
            self._pipes[self.peer(end)].clear()
            self._end(end)
            if not self._cuts:
                self._hang_up(end)

    def fall_silent(self, end: End) -> None:
        """End one side without telling the other."""
        self.cut("silence")
        self._expire(end)

    def _hang_up(self, end: End) -> None:
        self._loop.call_at(self._pipes[end].due_s, self._hung_up, self.peer(end), context=Context())

    def _hung_up(self, end: End) -> None:
        if not self._cuts:
            self._end(end)

    def _expire(self, end: End) -> None:
        for pipe in self._pipes.values():
            pipe.clear()
        self._end(end)

    def _end(self, end: End) -> None:
        if self._open[end]:
            self._open[end] = False
            end.detached(self)
            if not any(self._open.values()):
                self._end_leases()
                self._over(self)

    def _end_leases(self) -> None:
        for timer in self._leases.values():
            timer.cancel()
        self._leases.clear()
