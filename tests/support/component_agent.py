"""An agent of a robot with components, on the test's own clock, with a link that has no network."""

import asyncio
from collections.abc import Callable, Mapping
from typing import Annotated, Any

import msgspec
from msgspec import Meta, Raw

from linked_fleet_agent.agent import Agent
from linked_fleet_agent.components import BASE, Call, Component, action, event, unit, value
from linked_fleet_agent.robot import Facts, JointFacts, Reading, Robot
from linked_fleet_agent.wire import codec
from linked_fleet_agent.wire.components import Occurrence, Operate, Values
from linked_fleet_agent.wire.messages import Command, Condition, Move, Progress, Reply, State, Stop

URDF = """<robot name="r"><link name="base"/><link name="a"/><link name="b"/>
  <joint name="arm" type="continuous"><parent link="base"/><child link="a"/></joint>
  <joint name="finger" type="continuous"><parent link="base"/><child link="b"/></joint></robot>"""


class Done(msgspec.Struct):
    at: float


class Hand(Component, blocking=False, rate_hz=100, stale_s=3):
    """A hand whose actions end when the test lets them."""

    dropped = event(Done)
    told = event()

    def __init__(self) -> None:
        self.open_, self.ignore = asyncio.Event(), False
        self.begun: list[str] = []
        self.position: float = 0.0
        self.broken = ""
        self.lit = False

    @value
    def width(self) -> Annotated[float, unit("M"), Meta(ge=0)]:
        if self.broken:
            raise OSError(self.broken)
        return self.position

    @value
    def light(self) -> bool:
        return self.lit

    @light.setter
    def set_light(self, on: bool) -> None:
        self.lit = on

    async def _until_open(self) -> None:
        while True:
            try:
                await self.open_.wait()
                return
            except asyncio.CancelledError:
                if not self.ignore:
                    raise
                self.ignore = False  # the end of the test cancels it once more

    @action(moves=["finger"], duration_s=20, stop_s=0.5)
    async def grasp(self, call: Call[Done], force: Annotated[float, Meta(le=50)] = 20.0) -> Done:
        self.begun.append("grasp")
        call.progress(0.5, "closing")
        call.feedback(Done(force))
        await self._until_open()
        return Done(self.position)

    @action(moves=["finger"])
    async def release(self) -> None:
        self.begun.append("release")

    @action(moves=[BASE])
    async def roll(self) -> None:
        await self._until_open()

    @action()
    async def think(self) -> None:
        await self._until_open()

    @action()
    async def fail(self) -> None:
        raise OSError("no bus")

    @action()
    async def lie(self) -> Done:
        return "nothing"  # type: ignore[return-value]

    @action(rehearse=lambda self, seconds: seconds / 0.5)
    async def last(self, seconds: float) -> None: ...


class Memory:
    """A link without a network."""

    gateway_present, arrivals = True, 1

    def __init__(self) -> None:
        self.states: list[State] = []
        self.progress: list[Progress] = []
        self.conditions: list[Condition] = []
        self.values: list[Values] = []
        self.events: list[Occurrence] = []

    def watch_gateways(self, period_s: float) -> None:
        """Do nothing: the test says which gateways are present."""

    def publish_state(self, payload: bytes) -> None:
        self.states.append(codec.decode_state(payload))

    def publish_condition(self, payload: bytes) -> None:
        self.conditions.append(codec.decode(payload, Condition))

    def publish_progress(self, payload: bytes, final: bool) -> None:
        self.progress.append(codec.decode(payload, Progress))

    def publish_values(self, payload: bytes) -> None:
        self.values.append(codec.decode(payload, Values))

    def publish_event(self, payload: bytes) -> None:
        self.events.append(codec.decode(payload, Occurrence))


class ExactRobot:
    """A robot whose joints reach every setpoint at once, with the components that a test gives it."""

    def __init__(self, *components: Component) -> None:
        self.positions, self._components = {"arm": 0.0, "finger": 0.0}, components
        self.faulty = False

    def describe(self) -> Facts:
        joints = (JointFacts("arm", continuous=True), JointFacts("finger", continuous=True))
        return Facts("r", URDF, joints)

    def components(self) -> tuple[Component, ...]:
        return self._components

    def read(self, now_s: float) -> Reading:
        if self.faulty:
            raise OSError("cable out")
        return Reading(tuple(self.positions.values()), (0.0, 0.0), (0.0, 0.0))

    def apply(self, setpoints: Mapping[str, float]) -> Mapping[str, float]:
        self.positions |= setpoints
        return setpoints

    def stop(self) -> None: ...

    close = stop


class Bench:
    """An agent with a hand and ``more``, or of another robot."""

    def __init__(self, *more: Component, other: Robot | None = None) -> None:
        self.now_ns = 1_000_000_000
        self.hand, self.link = Hand(), Memory()
        self.robot = ExactRobot(self.hand, *more)
        self.agent = Agent(
            "r", other or self.robot, monotonic_ns=lambda: self.now_ns, wall_ns=lambda: self.now_ns + 10**18
        )
        self.agent.tick(self.link)

    async def tick(self, seconds: float = 0.01) -> None:
        for _ in range(max(1, round(seconds / 0.01))):
            self.now_ns += 10_000_000
            await asyncio.sleep(0)
            self.agent.tick(self.link)
            for _ in range(4):
                await asyncio.sleep(0)

    async def until(self, condition: Callable[[], Any]) -> None:
        """Tick until a condition holds that a thread of a component brings about."""
        async with asyncio.timeout(20):
            while not condition():
                await self.tick()
                await asyncio.sleep(0.002)

    def operate(self, id: str, action: str = "grasp", given: object = None, **changes: Any) -> Reply:
        request: dict[str, Any] = {
            "version": 2, "id": id, "incarnation": self.agent.incarnation, "component": "hand", "action": action,
            "seen_ns": self.link.states[-1].monotonic_ns, "time_to_live_ns": 60_000_000_000,
            "input": Raw(msgspec.json.encode(given)),
        }  # fmt: skip
        return codec.decode_reply(self.agent.handle_operate(codec.encode(Operate(**request | changes))))

    def move(self, id: str, **targets: float) -> Reply:
        command = Command(
            version=1, id=id, incarnation=self.agent.incarnation, seen_ns=self.link.states[-1].monotonic_ns,
            time_to_live_ns=60_000_000_000, motion=Move(targets),
        )  # fmt: skip
        return codec.decode_reply(self.agent.handle(codec.encode(command)))

    def stop(self, id: str, **more: Any) -> Reply:
        return codec.decode_reply(self.agent.handle_stop(codec.encode(Stop(version=1, id=id, **more))))

    def states(self, id: str) -> list[str]:
        found = [each.state for each in self.link.progress if each.id == id]
        return [state for index, state in enumerate(found) if index == 0 or found[index - 1] != state]

    def end(self, id: str) -> Progress:
        return [each for each in self.link.progress if each.id == id][-1]
