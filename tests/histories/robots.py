"""A robot with the product's agent, connected to the gateways by a link that loses and repeats messages."""

import asyncio
import json
import random
import time
from collections.abc import Callable, Collection, Mapping, Sequence
from contextvars import Context
from functools import partial

from fake_robots import SIMPLE
from histories.history import History
from linked_fleet_agent.agent import Agent
from linked_fleet_agent.components import Component, action
from linked_fleet_agent.robot import Facts, JointFacts, Limits, Reading
from linked_fleet_agent.wire.codec import decode, decode_reply, encode
from linked_fleet_agent.wire.components import Operate
from linked_fleet_agent.wire.messages import Accepted, Command, Description, Move, Progress, Refused, Reply, Stop
from linked_fleet_gateway.subscriptions.live import Live
from linked_fleet_link.fleet_link import NoAnswer
from linked_fleet_state.events import Appeared, Described, Framed

JOINT = "elbow"
_TICK_S = 0.02
_LOST, _UNANSWERED, _REPEATED = 0.03, 0.05, 0.1  # shares of commands
_AWAY_S = 0.005  # until a delayed copy arrives


class Hand(Component, blocking=False):
    """A component whose action moves the joint of the robot."""

    @action(moves=[JOINT])
    async def grip(self, at: float) -> None:
        """End at once."""


class Elbow:
    """A driver of one joint that reaches every setpoint at once, with a component that moves it too."""

    def __init__(self) -> None:
        self._position = 0.0

    def describe(self) -> Facts:
        return Facts("Toy", SIMPLE, (JointFacts(JOINT, limits=Limits(-1.0, 1.0, 2.0, 3.0)),))

    def components(self) -> Sequence[Component]:
        return (Hand(),)

    def read(self, now_s: float) -> Reading:
        return Reading((self._position,), (0.0,), (0.0,))

    def apply(self, setpoints: Mapping[str, float]) -> Mapping[str, float]:
        self._position = setpoints[JOINT]
        return setpoints

    def stop(self) -> None: ...

    def close(self) -> None: ...


class Witnessed:
    """The agent of one robot.

    ``ran`` is called for each command that it begins, with the command's id, the joint's target and the time of
    arrival.
    """

    def __init__(self, name: str, history: History, ran: Callable[[str, float, int], None]) -> None:
        self.name, self._history, self._ran = name, history, ran
        self.agent = Agent(name, Elbow(), rate_hz=1 / _TICK_S)

    def handle(self, payload: bytes) -> bytes:
        """Return the reply of the agent to a command."""
        command = decode(payload, Command)
        assert isinstance(command.motion, Move)
        return self._judged(command.id, command.motion.targets[JOINT], partial(self.agent.handle, payload))

    def handle_operate(self, payload: bytes) -> bytes:
        """Return the reply of the agent to a request to its component."""
        operate = decode(payload, Operate)
        target: float = json.loads(bytes(operate.input))["at"]
        return self._judged(operate.id, target, partial(self.agent.handle_operate, payload))

    def _judged(self, id: str, target: float, judge: Callable[[], bytes]) -> bytes:
        came_ns = self._history.now_ns()
        said = judge()
        reply = decode_reply(said)
        if isinstance(reply, Accepted):
            self._history.happened("command", id, "ran", came_ns)
            self._ran(id, target, came_ns)
        word = reply.code if isinstance(reply, Refused) else "accepted"
        self._history.happened("command", id, "send", came_ns, is_=word)
        return said


class Toy(Witnessed):
    """An agent that is also its own link: what it publishes reaches every gateway of this process."""

    gateway_present = True
    arrivals = 1

    def __init__(self, name: str, history: History, ran: Callable[[str, float, int], None]) -> None:
        super().__init__(name, history, ran)
        self._gateways: dict[Live, Context] = {}

    def meet(self, live: Live, context: Context) -> None:
        """Announce the robot to a gateway. In ``context`` the gateway gets progress."""
        now_ns = time.time_ns()
        live.fleet.apply(Appeared(self.name, self.agent.incarnation), now_ns)
        live.fleet.apply(Described(decode(self.agent.description, Description)), now_ns)
        self._gateways[live] = context
        self.agent.tick(self)

    def leave(self, live: Live) -> None:
        self._gateways.pop(live, None)  # also if a kill was interrupted

    async def run(self) -> None:
        while True:
            self.agent.tick(self)
            await asyncio.sleep(_TICK_S)

    def take(self, command: Command | Operate) -> Reply:
        handle = self.handle if isinstance(command, Command) else self.handle_operate
        return decode_reply(handle(encode(command)))

    def stop(self, stop: Stop) -> Reply:
        return decode_reply(self.agent.handle_stop(encode(stop)))

    # -- as the agent's link ------------------------------------------------------------------------------------------

    def watch_gateways(self, period_s: float) -> None:
        """Do nothing: gateways are always present."""

    def publish_state(self, payload: bytes) -> None:
        for live in self._gateways:
            live.fleet.apply(Framed(self.name, payload), time.time_ns())

    def publish_condition(self, payload: bytes) -> None:
        """Ignore it."""

    def publish_values(self, payload: bytes) -> None:
        """Ignore it."""

    def publish_event(self, payload: bytes) -> None:
        """Ignore it."""

    def publish_progress(self, payload: bytes, final: bool) -> None:
        progress, loop = decode(payload, Progress), asyncio.get_running_loop()
        for live, context in self._gateways.items():
            loop.call_soon(live.on_progress, self.name, progress, context=context)


class LossyLink:
    """A gateway's link to its robots: a command or its answer may be lost, and a command may arrive again later."""

    def __init__(self, robots: Mapping[str, Toy], draws: random.Random) -> None:
        self._robots, self._draws = robots, draws
        self._late: set[asyncio.Task[None]] = set()

    async def command(self, robot: str, command: Command | Operate, timeout_s: float) -> Reply:
        await asyncio.sleep(0)
        draw = self._draws.random()
        if draw < _LOST:
            raise NoAnswer("lost on its way")
        reply = self._robots[robot].take(command)
        if draw > 1 - _REPEATED:
            task = asyncio.create_task(self._again(robot, command))
            self._late.add(task)
            task.add_done_callback(self._late.discard)
        if draw < _LOST + _UNANSWERED:
            raise NoAnswer("its answer was lost")
        return reply

    async def _again(self, robot: str, command: Command | Operate) -> None:
        await asyncio.sleep(self._draws.random() * _AWAY_S)
        self._robots[robot].take(command)

    async def stop(self, robots: Collection[str] | None, stop: Stop, timeout_s: float) -> dict[str, Reply]:
        return {name: self._robots[name].stop(stop) for name in robots or self._robots}
