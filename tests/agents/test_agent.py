"""An agent with a simulated robot on one zenoh session, a gateway on another, both on loopback."""

import asyncio
import json
import os
import socket
import subprocess
import sys
from collections.abc import AsyncIterator, Awaitable, Callable, Mapping
from contextlib import asynccontextmanager, suppress
from dataclasses import dataclass, field

import pytest
import zenoh
from actor import play_gateway

from agents.agent import Agent
from agents.link import RobotLink
from agents.motion import Sway
from agents.robots.catalogue import load
from agents.transport import Session
from agents.wire import codec
from agents.wire.keys import Keys
from agents.wire.messages import (
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
from agents.zenoh_session import open_session

KEYS = Keys("test")
LEASE_MS = 500
PATIENCE_S = 30.0


async def eventually(condition: Callable[[], bool], what: str) -> None:
    """Await a condition; the patience only bounds a failing test."""
    try:
        async with asyncio.timeout(PATIENCE_S):
            while not condition():  # noqa: ASYNC110 - conditions are plain values set by zenoh threads
                await asyncio.sleep(0.005)
    except TimeoutError:
        pytest.fail(f"{what} did not come true")


def free_endpoint() -> str:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return f"tcp/127.0.0.1:{probe.getsockname()[1]}"


@dataclass
class Gateway:
    """The other side: collects frames and progress, asks and commands."""

    endpoint: str
    mode: str = "peer"
    frames: list[State] = field(default_factory=list)
    progress: list[Progress] = field(default_factory=list)

    def __enter__(self) -> "Gateway":
        config = zenoh.Config()
        for key, value in (
            ("mode", self.mode),
            ("listen/endpoints", [self.endpoint]),
            ("scouting/multicast/enabled", False),
        ):
            config.insert_json5(key, json.dumps(value))
        self.session = zenoh.open(config)
        self._held = (
            self.session.declare_subscriber(
                KEYS.all_states, lambda s: self.frames.append(codec.decode_state(s.payload.to_bytes()))
            ),
            self.session.declare_subscriber(
                KEYS.all_progress, lambda s: self.progress.append(codec.decode(s.payload.to_bytes(), Progress))
            ),
            play_gateway(self.session, KEYS, "g"),
        )
        return self

    def __exit__(self, *_: object) -> None:
        self.session.close()

    async def ask(self, key: str, payload: bytes | None = None) -> bytes:
        def get() -> list[bytes]:
            return [r.ok.payload.to_bytes() for r in self.session.get(key, payload=payload, timeout=5.0) if r.ok]

        [answer] = await asyncio.to_thread(get)
        return answer

    async def stop(self, robot: str, stop: Stop) -> Reply:
        return codec.decode_reply(await self.ask(KEYS.robot(robot, "stop"), codec.encode(stop)))

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
async def serving(agent: Agent, endpoint: str) -> AsyncIterator[RobotLink]:
    async with open_session((endpoint,), lease_ms=LEASE_MS) as session, _link(session, agent) as link:
        running = asyncio.create_task(agent.run(link))
        try:
            yield link
        finally:
            running.cancel()
            with suppress(asyncio.CancelledError):
                await running


def _link(session: Session, agent: Agent) -> RobotLink:
    return RobotLink(
        session,
        KEYS,
        robot=agent.name,
        incarnation=agent.incarnation,
        description=agent.description,
        on_command=agent.handle,
        on_stop=agent.handle_stop,
        lease_ms=LEASE_MS,
    )


def run(scenario: Callable[[Gateway, Agent], Awaitable[None]], mode: str = "peer", sway: str | None = None) -> None:
    """Run a scenario with one UR5 whose gateway is there."""

    async def together() -> None:
        agent = Agent("ur5", load("ur5", "ur5"), sways=[Sway(sway)] if sway else [])
        with Gateway(free_endpoint(), mode) as gateway:
            async with serving(agent, gateway.endpoint) as link:
                await eventually(lambda: link.gateway_present and len(gateway.frames) > 2, "frames and a gateway")
                await scenario(gateway, agent)

    asyncio.run(together())


@pytest.mark.parametrize("mode", ["peer", "router"])
def test_a_move_is_described_accepted_reached_and_reported_below_the_velocity_limit(mode: str) -> None:
    """The description decodes the frames; the joints arrive and none was faster than its URDF says."""

    async def scenario(gateway: Gateway, agent: Agent) -> None:
        description = codec.decode(await gateway.ask(KEYS.robot("ur5", "description")), Description)
        assert (description.robot, description.incarnation) == ("ur5", agent.incarnation)
        assert len(gateway.frames[-1].positions) == len(description.joints)
        limits = {joint.name: joint.limits for joint in load("ur5", "ur5").describe().joints}
        accepted = await gateway.command("ur5", {"elbow_joint": 0.9, "wrist_3_joint": 0.5}, "m")
        assert isinstance(accepted, Accepted)
        assert (accepted.id, accepted.duration_s, accepted.preempts) == ("m", pytest.approx(0.8472, abs=1e-3), ())
        await eventually(lambda: gateway.states_of("m")[-1:] == ["succeeded"], "success")
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

    run(scenario, mode)


def test_what_must_not_run_is_refused() -> None:
    """Stale, out of limits, repeated and malformed, each with its code."""

    async def scenario(gateway: Gateway, agent: Agent) -> None:
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


def test_the_robot_holds_when_the_last_gateway_goes_and_serves_the_next(caplog: pytest.LogCaptureFixture) -> None:
    """A motion fails as "gateway lost", the sway stops; a restarted gateway finds everything declared again."""

    async def scenario(gateway: Gateway, agent: Agent) -> None:
        joints = codec.decode(await gateway.ask(KEYS.robot("ur5", "description")), Description).joints
        elbow = joints.index("elbow_joint")
        assert (await gateway.command("ur5", {"elbow_joint": -3.0}, "m")).id == "m"
        await eventually(lambda: "running" in gateway.states_of("m"), "running")
        gateway.session.close()
        # A gateway back within one tick of the agent is no gap, so the next starts once the first is missed.
        await eventually(lambda: "the last gateway is gone" in caplog.text, "the agent noticing")
        with Gateway(gateway.endpoint) as second:
            await eventually(lambda: len(second.frames) > 200, "frames at the second gateway")
            assert second.frames[-1].positions[elbow] == pytest.approx(second.frames[-50].positions[elbow], abs=1e-3)
            assert second.frames[-1].positions[elbow] > -2.0
            alive = await asyncio.to_thread(
                lambda: [str(r.ok.key_expr) for r in second.session.liveliness().get(KEYS.all_presence) if r.ok]
            )
            assert alive == [KEYS.presence("ur5", agent.incarnation)]
            assert set(second.states_of("m")) == {"failed"}  # told once more a second after the gateway came
            assert isinstance(await second.command("ur5", {"elbow_joint": 0.5}, "n"), Accepted)
            await eventually(lambda: second.states_of("n")[-1:] == ["succeeded"], "success")

    run(scenario, sway="shoulder_pan_joint")


def test_a_stop_by_the_key_of_all_robots_ends_what_runs() -> None:
    """No gateway's token and no time is needed: whoever asks is heard, and the joints stand."""

    async def scenario(gateway: Gateway, agent: Agent) -> None:
        assert isinstance(await gateway.command("ur5", {"elbow_joint": -3.0}, "m"), Accepted)
        stop = Stop(version=WIRE_VERSION, id="s", reason="a person is near")
        reply = codec.decode_reply(await gateway.ask(KEYS.all_stops, codec.encode(stop)))
        assert isinstance(reply, Accepted)
        assert (reply.id, reply.preempts) == ("s", ("m",))
        await eventually(lambda: gateway.states_of("s")[-1:] == ["succeeded"], "a stop")
        [end] = [progress for progress in gateway.progress if progress.id == "m" and progress.state != "running"]
        assert (end.state, end.reason, end.successor) == ("cancelled", "a person is near", "s")
        assert codec.decode_reply(await gateway.ask(KEYS.robot("ur5", "stop"), b"{")).code == "malformed"  # type: ignore[union-attr]

    run(scenario, sway="shoulder_pan_joint")


def test_an_agent_waits_for_its_gateway() -> None:
    """Started first, it connects once somebody listens."""

    async def scenario() -> None:
        endpoint, agent = free_endpoint(), Agent("ur5", load("ur5", "ur5"))
        ready = asyncio.Event()

        async def serve() -> None:
            async with serving(agent, endpoint):
                ready.set()
                await asyncio.Event().wait()

        early = asyncio.create_task(serve())
        await asyncio.sleep(0)
        with Gateway(endpoint) as gateway:
            await eventually(lambda: ready.is_set() and len(gateway.frames) > 2, "frames")
            early.cancel()
            with suppress(asyncio.CancelledError):
                await early

    asyncio.run(scenario())


@pytest.mark.parametrize("module", ["agents.agent", "agents.link", "agents.__main__"])
def test_the_agent_is_light(module: str) -> None:
    """Importing it brings neither MuJoCo nor NumPy."""
    code = f"import sys, {module}; sys.exit(bool({{'mujoco', 'numpy'}} & sys.modules.keys()))"
    subprocess.run([sys.executable, "-c", code], check=True, env=os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)})
