"""A fan-out with a clock of its own, on a real fleet and tree of one robot, and outlets that keep their messages."""

import asyncio
import dataclasses
import heapq
import itertools
import math
from collections.abc import Callable
from typing import Any, ClassVar

import msgspec
import pytest

from fake_robots import joint, link, robot
from linked_fleet_agent.wire.codec import encode_state, layout
from linked_fleet_agent.wire.messages import WIRE_VERSION, Description, State
from linked_fleet_gateway.resources.subscription import Kind, Subscription
from linked_fleet_gateway.resources.tree import Tree
from linked_fleet_gateway.subscriptions import fan_out
from linked_fleet_gateway.subscriptions.broadcast import Ending, Message
from linked_fleet_gateway.subscriptions.fan_out import FanOut
from linked_fleet_gateway.subscriptions.watcher import Timer, Watcher
from linked_fleet_identity.rights import View
from linked_fleet_state.events import Appeared, Described, Event, Framed
from linked_fleet_state.fleet import Fleet
from linked_fleet_state.invocations import Invocations

BASE = "http://fleet.example"
URDF = robot(link("base"), link("tip"), joint("elbow", "revolute", "base", "tip"))
OTHER_URDF = URDF.replace("elbow", "wrist")
ROTATION, JOINT, ROBOT = "/r/elbow/rotation", "/r/elbow", "/r/"
_ids = itertools.count()


class _Alarm:
    def __init__(self, call: Callable[[], None]) -> None:
        self.call: Callable[[], None] | None = call

    def cancel(self) -> None:
        self.call = None


class Clocked(FanOut):
    """A fan-out whose clock the test advances."""

    present_s = 100.0

    def __init__(self, tree: Callable[[str, View], Tree], next_moved: Callable[[], str | None]) -> None:
        super().__init__(tree, next_moved)
        self._alarms: list[tuple[float, int, _Alarm]] = []

    def now_s(self) -> float:
        return self.present_s

    def call_later(self, delay_s: float, call: Callable[[], None]) -> Timer:
        alarm = _Alarm(call)
        heapq.heappush(self._alarms, (self.present_s + delay_s, next(_ids), alarm))
        return alarm

    def advance(self, seconds: float) -> None:
        self.present_s += seconds
        while self._alarms and self._alarms[0][0] <= self.present_s:
            alarm = heapq.heappop(self._alarms)[2]
            if alarm.call is not None:
                alarm.call()

    @property
    def idle(self) -> bool:
        return not (self._dirty or self._scans or self._runnable)

    @property
    def empty(self) -> bool:
        """True if nothing of former watchers is kept."""
        return not (self._topics or self._of_robot or self._subtrees or self._absent or self._dirty or self._scans)


class Outlet:
    watcher: Watcher

    def __init__(self) -> None:
        self.messages: list[Message] = []
        self.room = True
        self.ending: Ending | None = None

    def writable(self) -> bool:
        return self.room

    def write(self, message: Message) -> None:
        assert self.room and self.ending is None
        self.messages.append(message)

    def end(self, ending: Ending) -> None:
        self.ending = ending

    @property
    def versions(self) -> list[str]:
        return [message.version for message in self.messages]

    @property
    def previous(self) -> list[str | None]:
        """The previous version stated in each message."""
        found = [
            message.body.decode().partition('previousVersion> "')[2].partition('"')[0] for message in self.messages
        ]
        return [version or None for version in found]

    @property
    def frames(self) -> list[int]:
        """The number of the frame shown in each message."""
        return [int(version.partition("-")[2]) for version in self.versions]

    def take(self) -> list[str]:
        """Return the paths of the messages so far, and forget them."""
        paths = [message.path for message in self.messages]
        self.messages.clear()
        return paths


class _Frame(bytes):
    """Framed bytes that know their message."""

    message: Message


def _framed(message: Message) -> bytes:
    frame = _Frame(message.body)
    frame.message = message
    return frame


class InStep(Outlet):
    """An outlet that can share a broadcast, as WebSockets and event streams can."""

    def __init__(self) -> None:
        super().__init__()
        self.framing = _framed

    def send(self, frame: bytes) -> bool:
        if not self.room or self.ending is not None:
            return False
        assert isinstance(frame, _Frame)
        self.messages.append(frame.message)
        return True

    def write(self, message: Message) -> None:
        assert self.room
        self.send(message.frame_with(self.framing))


class World:
    """A fleet with one robot; every step waits until the fan-out has nothing left to do."""

    outlet = Outlet
    failures: ClassVar[list[dict[str, Any]]] = []

    def __init__(self) -> None:
        asyncio.get_running_loop().set_exception_handler(lambda _, context: self.failures.append(context))
        self.fleet, self.invocations = Fleet(), Invocations()
        self.fan_out = Clocked(
            lambda base, sees: Tree(self.fleet, self.invocations, base, visible_robots=sees), self.fleet.next_moved
        )
        self.fleet.frames.watched = self.fan_out.watched_robots
        self._sequence = itertools.count()

    def tell(self, *events: Event) -> None:
        for event in events:
            for change in self.fleet.apply(event, 1):
                (self.fan_out.mark_moved if change.what == "frame" else self.fan_out.mark_robot_changed)(change.robot)

    async def apply(self, *events: Event) -> None:
        self.tell(*events)
        await self.settle()

    async def settle(self) -> None:
        while not self.fan_out.idle:  # noqa: ASYNC110 - a turn is a callback of the loop
            await asyncio.sleep(0)

    async def up(self) -> "World":
        await self.apply(Appeared("r", 1), Described(described()), self.frame(0.0))
        return self

    def frame(self, elbow: float) -> Framed:
        nan, sequence = (math.nan,), next(self._sequence)
        state = State(
            incarnation=1, sequence=sequence, monotonic_ns=sequence, wall_ns=1000 + sequence,
            positions=(elbow,), velocities=nan, efforts=nan,
        )  # fmt: skip
        return Framed("r", encode_state(state))

    async def move(self, *elbow: float) -> None:
        for angle in elbow:
            await self.apply(self.frame(angle))

    async def advance(self, seconds: float) -> None:
        self.fan_out.advance(seconds)
        await self.settle()


def described(incarnation: int = 1, **changed: object) -> Description:
    base = Description(
        version=WIRE_VERSION, robot="r", incarnation=incarnation, title="R", urdf=URDF, joints=("elbow",),
        rate_hz=50, layout=layout(1, False), capabilities=("move",),
    )  # fmt: skip
    return msgspec.structs.replace(base, **changed)


def to(path: str, **more: object) -> Subscription:
    values: dict[str, object] = {
        "id": str(next(_ids)), "owner": "/", "resource": path, "kind": Kind.WEBSOCKET,
        "media_type": "application/n-triples", "base": BASE, "client": "", "created_ns": 0,
    }  # fmt: skip
    return Subscription(**(values | more))  # type: ignore[arg-type]


def watch(world: World, path: str, sent: dict[str, str] | None = None, patient: bool = False, **more: object) -> Outlet:
    outlet = world.outlet()
    outlet.watcher = world.fan_out.watch(to(path, **more), outlet, sent, wait_if_absent=patient)
    return outlet


async def begin(world: World, path: str, **more: object) -> Outlet:
    """Return an outlet that is ready and has got the present state."""
    outlet = watch(world, path, **more)
    outlet.watcher.schedule_send()
    await world.settle()
    return outlet


async def begin_many(world: World, path: str, count: int) -> list[Outlet]:
    """Return outlets that are ready, and have got and forgotten the present state."""
    outlets = [watch(world, path) for _ in range(count)]
    for outlet in outlets:
        outlet.watcher.schedule_send()
    await world.settle()
    for outlet in outlets:
        outlet.take()
    return outlets


def change_options(world: World, outlet: Outlet, **options: object) -> None:
    watcher = outlet.watcher  # type: ignore[attr-defined]
    world.fan_out.change_options(watcher, dataclasses.replace(watcher.subscription, **options))


def limit_turn(monkeypatch: pytest.MonkeyPatch, looks: int) -> None:
    """End a turn after so many reads of the clock."""
    ticks = itertools.count()
    monkeypatch.setattr(fan_out.time, "perf_counter", lambda: next(ticks) * fan_out.TURN_S / looks)
