"""The live fleet joined to its link: events in, commands out, and who waits for what (flows "state" and "action")."""

import asyncio
import logging
import math
import time
import uuid
from types import TracebackType

from agents.wire.keys import Keys
from agents.wire.messages import WIRE_VERSION, Command, Move, Progress, Refused
from gateway.errors import AgentSilent, Offline, RefusedByAgent
from gateway.fleet.events import Event
from gateway.fleet.fleet import Fleet
from gateway.fleet.invocations import Invocation, Invocations, InvocationState
from gateway.fleet.robot import Robot
from gateway.graph.invocation import invocation_path, invocations_path
from gateway.graph.tree import EMPTY, Shelf, Tree
from gateway.link import FleetLink, NoAnswer
from gateway.settings import GatewaySettings
from gateway.subscriptions.fan_out import FanOut

log = logging.getLogger(__name__)

COMMAND_TIME_TO_LIVE_NS = 2_000_000_000
_ANSWER_TIMEOUT_S = 2.0
_SETTLING_S = 15.0
_SLOWEST_SHARE = 0.2  # a motion slower than a fifth of its velocity limit is given up
_FALLBACK_VELOCITY = 0.5  # rad/s or m/s, only to bound the waiting for a joint without a velocity limit
_EXPIRY_INTERVAL_S = 1.0


class Live:
    """Owns the fleet, its invocations and the link; an async context manager."""

    def __init__(self, settings: GatewaySettings) -> None:
        self.fleet = Fleet()
        self.invocations = Invocations()
        self.fan_out = FanOut(self.tree)
        self._link = FleetLink(
            Keys(settings.namespace),
            settings.gateway_name,
            settings.listen_endpoints,
            settings.connect_endpoints,
            self._on_events,
            self._on_progress,
        )
        self._ended: dict[str, asyncio.Event] = {}
        self._expiry: asyncio.Task[None] | None = None

    async def __aenter__(self) -> "Live":
        await self._link.__aenter__()
        self._expiry = asyncio.create_task(self._expire_for_ever(), name="expire invocations")
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self._expiry is not None:
            self._expiry.cancel()
        await self._link.__aexit__(kind, error, trace)

    def tree(self, base: str, shelf: Shelf = EMPTY) -> Tree:
        """The resource tree as it is now, under one base URL; ``shelf`` are the subscriptions that it can show."""
        return Tree(self.fleet, self.invocations, base, shelf)

    async def invoke(self, robot: Robot, action: str, move: Move) -> Invocation:
        """Send the motion and return its invocation once the agent accepted it.

        Raises Offline without a live robot, RefusedByAgent with the agent's reason, AgentSilent when no answer came:
        then the invocation is "unknown" until progress or its deadline settles it.
        """
        frame = robot.frame
        if not robot.online or robot.incarnation is None or frame is None:
            since = "has not sent a frame yet" if robot.online else "is offline"
            raise Offline(f"Robot {robot.name} {since}; its actions answer again once it is back.")
        now_ns = time.time_ns()
        invocation = Invocation(
            id=str(uuid.uuid4()),
            robot=robot.name,
            action=action,
            targets=dict(move.targets),
            created_ns=now_ns,
            deadline_ns=now_ns + int(_patience_s(robot, move) * 1e9),
        )
        command = Command(
            version=WIRE_VERSION,
            id=invocation.id,
            incarnation=robot.incarnation,
            seen_ns=frame.monotonic_ns,
            time_to_live_ns=COMMAND_TIME_TO_LIVE_NS,
            motion=move,
        )
        self.invocations.add(invocation)
        self.fan_out.appeared(invocation_path(invocation))
        self._tell(invocation)
        self._ended[invocation.id] = asyncio.Event()
        try:
            reply = await self._link.command(robot.name, command, _ANSWER_TIMEOUT_S)
        except NoAnswer as error:
            if invocation.state is InvocationState.ACCEPTED:
                invocation.state = InvocationState.UNKNOWN
                invocation.reason = "the agent gave no answer; progress or the deadline will settle it"
                self._tell(invocation)
            raise AgentSilent(
                f"The agent of {robot.name} gave no answer: {error}. The invocation stays until that is settled.",
                headers={"location": f"{action}/invocations/{invocation.id}"},
            ) from error
        if isinstance(reply, Refused):
            invocation.state, invocation.reason = InvocationState.FAILED, reply.reason
            invocation.ended_ns = time.time_ns()
            self._settle(invocation)
            raise RefusedByAgent(f"The agent of {robot.name} refused ({reply.code}): {reply.reason}")
        return invocation

    async def ended(self, invocation: Invocation, timeout_s: float) -> bool:
        """Wait until the invocation has ended; False when ``timeout_s`` passed before."""
        event = self._ended.get(invocation.id)
        if invocation.state.terminal or event is None:
            return invocation.state.terminal
        try:
            async with asyncio.timeout(timeout_s):
                await event.wait()
        except TimeoutError:
            return False
        return True

    def _on_events(self, events: list[Event]) -> None:
        now_ns = time.time_ns()
        for event in events:
            for change in self.fleet.apply(event, now_ns):
                if change.what == "frame":
                    self.fan_out.moved(change.robot)
                    continue
                log.info("robot %s: %s", change.robot, change.what)
                self.fan_out.changed(change.robot)
                if change.what == "vanished":
                    for invocation in self.invocations.lose(change.robot):
                        self._tell(invocation)

    def _on_progress(self, robot: str, progress: Progress) -> None:
        invocation = self.invocations.apply(robot, progress)
        if invocation is None:
            return
        if invocation.state.terminal:
            self._settle(invocation)
        else:
            self._tell(invocation)

    def _tell(self, invocation: Invocation) -> None:
        """Its resource, and the container that lists it, are different now."""
        self.fan_out.touched(invocation_path(invocation))
        self.fan_out.touched(invocations_path(invocation.action))

    def _settle(self, invocation: Invocation) -> None:
        self._tell(invocation)
        event = self._ended.pop(invocation.id, None)
        if event is not None:
            event.set()

    async def _expire_for_ever(self) -> None:
        while True:
            await asyncio.sleep(_EXPIRY_INTERVAL_S)
            for invocation in self.invocations.expire(time.time_ns()):
                self._settle(invocation)


def _patience_s(robot: Robot, move: Move) -> float:
    """How long the gateway waits for word of a motion: far longer than the motion can take."""
    longest = 0.0
    for name, target in move.targets.items():
        joint = robot.model.joints.get(name) if robot.model else None
        velocity = (joint.limits.velocity if joint else None) or _FALLBACK_VELOCITY
        present = robot.positions.get(name, math.nan)
        distance = abs(target - present) if not math.isnan(present) else 2 * math.tau
        longest = max(longest, distance / (velocity * _SLOWEST_SHARE))
    return longest + _SETTLING_S
