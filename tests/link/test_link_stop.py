"""Stops through the link reach every reachable robot, and commands to a frozen agent never move anything."""

import asyncio
import signal
from collections.abc import Awaitable, Callable

import pytest

from linked_fleet_agent.wire import codec
from linked_fleet_agent.wire.keys import Keys
from linked_fleet_agent.wire.messages import (
    WIRE_VERSION,
    Accepted,
    Command,
    Description,
    Move,
    Progress,
    Refused,
    State,
    Stop,
)
from linked_fleet_link.fleet_link import FleetLink, NoAnswer
from linked_fleet_state.events import Described, Event, Framed
from running import Process, free_port, process
from virtual.processes import gateway_session

pytestmark = pytest.mark.virtual
KEYS = Keys("site/hall-3")


class Gateway:
    """An open link that keeps the last frame of each robot, and all progress."""

    def __init__(self, endpoint: str) -> None:
        self.described: dict[str, Description] = {}
        self.frames: dict[str, State] = {}
        self.progress: dict[tuple[str, str], list[Progress]] = {}
        self._changed = asyncio.Event()
        self.link = FleetLink(KEYS, "g", lambda: gateway_session(endpoint), self._on_events, self._on_progress)

    def _on_events(self, events: list[Event]) -> None:
        for event in events:
            if isinstance(event, Described):
                self.described[event.description.robot] = event.description
            elif isinstance(event, Framed):
                self.frames[event.robot] = codec.decode_state(event.payload)
        self._changed.set()

    def _on_progress(self, robot: str, progress: Progress) -> None:
        self.progress.setdefault((robot, progress.id), []).append(progress)
        self._changed.set()

    async def until(self, condition: Callable[[], bool]) -> None:
        while not condition():
            self._changed.clear()
            await self._changed.wait()

    async def command(
        self,
        robot: str,
        command_id: str,
        ttl_s: float,
        timeout_s: float,
        seen: State | None = None,
        rehearsal: bool = False,
        **targets: float,
    ) -> object:
        frame = seen or self.frames[robot]
        command = Command(
            version=WIRE_VERSION,
            id=command_id,
            incarnation=frame.incarnation,
            seen_ns=frame.monotonic_ns,
            time_to_live_ns=round(ttl_s * 1e9),
            motion=Move(targets),
            rehearsal=rehearsal,
        )
        return await self.link.command(robot, command, timeout_s)

    async def known_to(self, robot: str) -> None:
        """Wait until the agent knows a gateway; it moves nothing before."""
        while isinstance(await self.command(robot, "asked", 30.0, 30.0, rehearsal=True, elbow_joint=0.0), Refused):
            pass

    async def moving(self, robot: str) -> None:
        """Begin a long motion and wait until the joint is moving."""
        await self.known_to(robot)
        assert isinstance(await self.command(robot, "m", 30.0, 30.0, elbow_joint=-3.0), Accepted)
        elbow = self.described[robot].joints.index("elbow_joint")
        await self.until(lambda: self.frames[robot].velocities[elbow] < -0.5)

    def end(self, robot: str, command_id: str) -> str:
        told = self.progress.get((robot, command_id), [])
        return told[-1].state if told else ""


def run(scenario: Callable[[Gateway, Process], Awaitable[None]]) -> None:
    """Run three agents and a gateway: ``a`` and ``b`` in one process, ``c`` in the one given to the scenario."""
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    where = ("--connect", endpoint, "--namespace", KEYS.namespace)

    async def joined(other: Process) -> None:
        gateway = Gateway(endpoint)
        async with gateway.link:
            await gateway.link.join()
            await gateway.until(lambda: len(gateway.described) == len(gateway.frames) == 3)
            await scenario(gateway, other)

    with (
        process("-m", "linked_fleet_agent", "--robot=a=ur5", "--robot=b=ur5", *where),
        process("-m", "linked_fleet_agent", "--robot=c=ur5", *where) as other,
    ):
        asyncio.run(joined(other))


@pytest.mark.parametrize("names", [None, ("a", "b", "c")])
def test_a_frozen_agent_keeps_no_other_from_stopping(names: tuple[str, ...] | None) -> None:
    async def scenario(gateway: Gateway, other: Process) -> None:
        for robot in ("a", "b", "c"):
            await gateway.moving(robot)
        other.send(signal.SIGSTOP)
        replies = await gateway.link.stop(names, Stop(version=WIRE_VERSION, id="s"), 1.0)
        assert {robot: isinstance(reply, Accepted) and reply.preempts for robot, reply in replies.items()} == {
            "a": ("m",),
            "b": ("m",),
        }
        await gateway.until(lambda: gateway.end("a", "s") == gateway.end("b", "s") == "succeeded")
        assert gateway.end("a", "m") == gateway.end("b", "m") == "cancelled"

    run(scenario)


def test_a_stop_is_answered_while_many_commands_wait_for_a_frozen_agent() -> None:
    async def scenario(gateway: Gateway, other: Process) -> None:
        await gateway.moving("a")
        other.send(signal.SIGSTOP)
        waiting = [
            asyncio.create_task(gateway.command("c", f"c{number}", 30.0, 30.0, elbow_joint=0.0)) for number in range(40)
        ]
        replies = await gateway.link.stop(["a"], Stop(version=WIRE_VERSION, id="s"), 30.0)
        assert replies.keys() == {"a"}
        assert not any(task.done() for task in waiting)
        other.send(signal.SIGCONT)
        assert all(isinstance(each, Accepted | Refused) for each in await asyncio.gather(*waiting))

    run(scenario)


def test_only_valid_replies_are_returned() -> None:
    """A missing robot is left out; a refusal is a reply; a stop is for one robot only if it says so."""

    async def scenario(gateway: Gateway, other: Process) -> None:
        await gateway.moving("a")
        await gateway.moving("b")
        stop = Stop(version=WIRE_VERSION, id="s", joints=("elbow_joint",))
        assert (await gateway.link.stop(["a", "nobody"], stop, 30.0)).keys() == {"a"}
        assert await gateway.link.stop((), stop, 30.0) == {}
        refused = await gateway.link.stop(["b"], Stop(version=WIRE_VERSION, id="t", joints=("leg",)), 30.0)
        assert isinstance(refused["b"], Refused)
        await gateway.until(lambda: gateway.end("a", "m") == "cancelled" and gateway.end("a", "s") == "succeeded")
        assert gateway.end("b", "m") == "running"

    run(scenario)


def test_commands_requested_before_a_stop_are_refused() -> None:
    """However recent it is; a client with a frame later than the reply to the stop may continue."""

    async def scenario(gateway: Gateway, other: Process) -> None:
        before = gateway.frames["c"]
        stopped = (await gateway.link.stop(None, Stop(version=WIRE_VERSION, id="s"), 30.0))["c"]
        assert isinstance(stopped, Accepted)
        refused = await gateway.command("c", "early", 60.0, 30.0, before, wrist_3_joint=0.2)
        assert isinstance(refused, Refused)
        assert refused.code == "stale"
        await gateway.until(lambda: gateway.frames["c"].monotonic_ns > stopped.at_ns)
        assert isinstance(await gateway.command("c", "fresh", 60.0, 30.0, wrist_3_joint=0.2), Accepted)
        await gateway.until(lambda: gateway.end("c", "fresh") == "succeeded")

    run(scenario)


def test_an_agent_that_comes_back_executes_no_backlog() -> None:
    """Commands sent while it was frozen are stale by then; the next fresh command is the first to run."""

    async def scenario(gateway: Gateway, other: Process) -> None:
        before = gateway.frames["c"]
        other.send(signal.SIGSTOP)

        async def in_vain(command_id: str) -> None:
            with pytest.raises(NoAnswer):
                await gateway.command("c", command_id, 0.1, 0.5, elbow_joint=-3.0)

        await asyncio.gather(*(in_vain(f"late{number}") for number in range(5)))
        other.send(signal.SIGCONT)
        await gateway.until(lambda: gateway.frames["c"].monotonic_ns > before.monotonic_ns + 500_000_000)
        assert gateway.frames["c"].positions == pytest.approx(before.positions, abs=1e-4)
        assert isinstance(await gateway.command("c", "fresh", 30.0, 30.0, wrist_3_joint=0.2), Accepted)
        await gateway.until(lambda: gateway.end("c", "fresh") == "succeeded")
        assert {command_id for robot, command_id in gateway.progress if robot == "c"} == {"fresh"}

    run(scenario)
