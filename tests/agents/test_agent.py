"""An agent with a simulated robot on one session, a gateway on another."""

import asyncio
import os
import subprocess
import sys
from collections.abc import AsyncIterator, Awaitable, Callable, Mapping
from contextlib import asynccontextmanager

import pytest

from linked_fleet_agent.pace import every
from linked_fleet_agent.robots.catalogue import load
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
    Reply,
    State,
    Stop,
)
from linked_fleet_agent.wire.transport import HEARTBEAT_S
from linked_fleet_link.transport import Answer, Question, Session
from linked_fleet_state.events import Payload
from running import Process, free_port, process
from serving import until
from virtual.processes import gateway_session

pytestmark = pytest.mark.virtual
KEYS = Keys("test")
MAX_BYTES = 2**20


class Gateway:
    """The other side: collects frames and progress, sends questions and commands."""

    def __init__(self, endpoint: str, session: Session) -> None:
        self.endpoint, self.session = endpoint, session
        self.frames: list[State] = []
        self.progress: list[Progress] = []

    def take_state(self, _: str, payload: Payload) -> None:
        assert isinstance(payload, bytes)
        self.frames.append(codec.decode_state(payload))

    def take_progress(self, _: str, payload: Payload) -> None:
        assert isinstance(payload, bytes)
        self.progress.append(codec.decode(payload, Progress))

    async def ask(self, key: str, payload: bytes | None = None) -> bytes:
        answers: asyncio.Queue[Answer | None] = asyncio.Queue()
        await self.session.ask(Question(key, payload, 5.0, MAX_BYTES), answers.put_nowait)
        first, end = await answers.get(), await answers.get()
        assert first is not None and isinstance(first.payload, bytes) and end is None
        return first.payload

    async def description(self) -> Description:
        return codec.decode(await self.ask(KEYS.robot("ur5", "description")), Description)

    async def command(self, robot: str, targets: Mapping[str, float], command_id: str, late_ns: int = 0) -> Reply:
        frame = self.frames[-1]
        command = Command(
            version=WIRE_VERSION,
            id=command_id,
            incarnation=frame.incarnation,
            seen_ns=frame.monotonic_ns - late_ns,
            time_to_live_ns=5_000_000_000,
            motion=Move(dict(targets)),
        )
        return codec.decode_reply(await self.ask(KEYS.robot(robot, "command"), codec.encode(command)))

    def states_of(self, command_id: str) -> list[str]:
        return [progress.state for progress in self.progress if progress.id == command_id]


@asynccontextmanager
async def opened(endpoint: str) -> AsyncIterator[Gateway]:
    session = await gateway_session(endpoint)
    gateway = Gateway(endpoint, session)
    await session.subscribe(KEYS.all_states, MAX_BYTES, gateway.take_state)
    await session.subscribe(KEYS.all_progress, MAX_BYTES, gateway.take_progress)
    await session.declare_token(KEYS.gateway("g"))
    beating = asyncio.create_task(every(HEARTBEAT_S, session.declare_heartbeat(KEYS.heartbeat("g"))))
    try:
        yield gateway
    finally:
        beating.cancel()
        await session.close()


def run(scenario: Callable[[Gateway, Process], Awaitable[None]], *flags: str) -> None:
    """Run a scenario with one UR5, whose agent waits for its gateway."""
    endpoint = f"tcp/127.0.0.1:{free_port()}"

    async def together(agent: Process) -> None:
        async with opened(endpoint) as gateway:
            await until(lambda: len(gateway.frames) > 2)
            await scenario(gateway, agent)

    with process(
        "-m", "linked_fleet_agent", "--robot=ur5", "--connect", endpoint, "--namespace", "test", *flags
    ) as agent:
        asyncio.run(together(agent))


def test_a_move_is_described_accepted_reached_and_reported_below_the_velocity_limit() -> None:
    """The description decodes the frames; the joints reach their targets, none faster than in the URDF."""

    async def scenario(gateway: Gateway, agent: Process) -> None:
        description = await gateway.description()
        assert (description.robot, description.incarnation) == ("ur5", gateway.frames[-1].incarnation)
        assert len(gateway.frames[-1].positions) == len(description.joints)
        limits = {joint.name: joint.limits for joint in load("ur5", "ur5").describe().joints}
        accepted = await gateway.command("ur5", {"elbow_joint": 0.9, "wrist_3_joint": 0.5}, "m")
        assert isinstance(accepted, Accepted)
        assert (accepted.id, accepted.duration_s, accepted.preempts) == ("m", pytest.approx(0.8472, abs=1e-3), ())
        await until(lambda: gateway.states_of("m")[-1:] == ["succeeded"])
        assert gateway.states_of("m") == ["running"] * (len(gateway.progress) - 1) + ["succeeded"]
        shares = [progress.progress for progress in gateway.progress]
        assert len(set(shares)) > 3
        assert shares == sorted(shares)
        assert (shares[0], shares[-1]) == (0.0, 1.0)
        assert gateway.progress[-1].positions == pytest.approx({"elbow_joint": 0.9, "wrist_3_joint": 0.5}, abs=2e-4)
        for index, joint in enumerate(description.joints):
            limit = limits[joint].velocity
            assert limit is not None
            assert max(abs(frame.velocities[index]) for frame in gateway.frames) <= limit
        numbers = [frame.sequence for frame in gateway.frames]
        assert numbers == sorted(set(numbers))

    run(scenario)


def test_invalid_commands_are_refused_with_their_codes() -> None:
    """Stale, out-of-limit, repeated and malformed commands are refused, each with its code."""

    async def scenario(gateway: Gateway, agent: Process) -> None:
        async def code(targets: dict[str, float], command_id: str, late_ns: int = 0) -> str:
            reply = await gateway.command("ur5", targets, command_id, late_ns)
            return reply.code if isinstance(reply, Refused) else "accepted"

        assert await code({"elbow_joint": 1.5}, "a", late_ns=5_000_000_000) == "stale"
        assert await code({"elbow_joint": 4.0}, "a") == "limits"
        assert await code({"elbow_joint": 1.5}, "a") == "accepted"
        assert await code({"elbow_joint": 1.5}, "a") == "repeated"
        for payload, wanted in ((b"{", "malformed"), (b'{"version": 999}', "version")):
            reply = codec.decode_reply(await gateway.ask(KEYS.robot("ur5", "command"), payload))
            assert isinstance(reply, Refused)
            assert reply.code == wanted

    run(scenario)


def test_the_robot_holds_when_the_last_gateway_goes_and_serves_the_next() -> None:
    """A motion fails as "gateway lost", the sway stops; a restarted gateway finds everything declared again."""

    async def scenario(gateway: Gateway, agent: Process) -> None:
        description = await gateway.description()
        elbow = description.joints.index("elbow_joint")
        assert (await gateway.command("ur5", {"elbow_joint": -3.0}, "m")).id == "m"
        await until(lambda: "running" in gateway.states_of("m"))
        await gateway.session.close()
        # A gateway back within one tick of the agent is no gap, so the next starts once the first is missed.
        await until(lambda: "the last gateway is gone" in agent.output)
        async with opened(gateway.endpoint) as second:
            await until(lambda: len(second.frames) > 200)
            assert second.frames[-1].positions[elbow] == pytest.approx(second.frames[-50].positions[elbow], abs=1e-3)
            assert second.frames[-1].positions[elbow] > -2.0
            alive, _ = await second.session.list_tokens(KEYS.all_presence, 5.0, list)
            assert alive == [KEYS.presence("ur5", description.incarnation)]
            routed, _ = await second.session.list_tokens(KEYS.all_states, 5.0, list)
            assert routed == [KEYS.robot("ur5", "state")], "routers know the key of frames"
            assert set(second.states_of("m")) == {"failed"}  # repeated a second after the gateway came
            assert isinstance(await second.command("ur5", {"elbow_joint": 0.5}, "n"), Accepted)
            await until(lambda: second.states_of("n")[-1:] == ["succeeded"])

    run(scenario, "--sway", "ur5:shoulder_pan_joint")


def test_a_stop_of_all_robots_ends_running_motions() -> None:
    """It needs neither a gateway's token nor a time: anybody may stop, and the joints come to rest."""

    async def scenario(gateway: Gateway, agent: Process) -> None:
        assert isinstance(await gateway.command("ur5", {"elbow_joint": -3.0}, "m"), Accepted)
        stop = Stop(version=WIRE_VERSION, id="s", reason="a person is near")
        reply = codec.decode_reply(await gateway.ask(KEYS.all_stops, codec.encode(stop)))
        assert isinstance(reply, Accepted)
        assert (reply.id, reply.preempts) == ("s", ("m",))
        await until(lambda: gateway.states_of("s")[-1:] == ["succeeded"])
        [end] = [progress for progress in gateway.progress if progress.id == "m" and progress.state != "running"]
        assert (end.state, end.reason, end.successor) == ("cancelled", "a person is near", "s")
        assert codec.decode_reply(await gateway.ask(KEYS.robot("ur5", "stop"), b"{")).code == "malformed"  # type: ignore[union-attr]

    run(scenario, "--sway", "ur5:shoulder_pan_joint")


@pytest.mark.parametrize(
    "module", ["linked_fleet_agent.agent", "linked_fleet_agent.link", "linked_fleet_agent.__main__"]
)
def test_the_agent_is_light(module: str) -> None:
    """Importing it brings neither MuJoCo nor NumPy."""
    code = f"import sys, {module}; sys.exit(bool({{'mujoco', 'numpy'}} & sys.modules.keys()))"
    subprocess.run([sys.executable, "-c", code], check=True, env=os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)})
