"""The link against real Zenoh sessions on a free loopback port."""

import asyncio
import contextlib
import socket
import time
from collections.abc import AsyncIterator, Awaitable, Callable, Iterator

import pytest
import zenoh
from actor import stage
from running import eventually

from agents.wire.codec import encode, encode_state, layout
from agents.wire.keys import Keys
from agents.wire.messages import WIRE_VERSION, Accepted, Command, Description, Move, Progress, Refused, Reply, State
from agents.wire.transport import HEARTBEAT_S
from gateway import heartbeat
from gateway.fleet.fleet import Appeared, Described, Event, Framed, Undescribed, Vanished
from gateway.link import FleetLink, LinkError, NoAnswer

KEYS = Keys("site/hall-2")
URDF = "<robot name='r'><link name='base'/></robot>"
pytestmark = pytest.mark.filterwarnings("error")


def run(test: Callable[..., Awaitable[None]], *arguments: object) -> None:
    """Run an async test in a loop of its own; one that hangs fails."""

    async def bounded() -> None:
        async with asyncio.timeout(10):
            await test(*arguments)

    asyncio.run(bounded())


@pytest.fixture
def endpoint() -> str:
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        return f"tcp/127.0.0.1:{free.getsockname()[1]}"


class Gateway:
    """Collects what the link reports and wakes whoever waits for it."""

    def __init__(self, endpoint: str, name: str = "g") -> None:
        self.events: list[Event] = []
        self.progress: list[tuple[str, Progress]] = []
        self._changed = asyncio.Event()
        self.link = FleetLink(KEYS, name, (endpoint,), (), self._on_events, self._on_progress)

    def _on_events(self, events: list[Event]) -> None:
        self.events += events
        self._changed.set()

    def _on_progress(self, robot: str, progress: Progress) -> None:
        self.progress.append((robot, progress))
        self._changed.set()

    async def until(self, condition: Callable[[], bool]) -> None:
        while not condition():
            self._changed.clear()
            await self._changed.wait()

    async def seen(self, event: Event) -> None:
        await self.until(lambda: event in self.events)


@contextlib.asynccontextmanager
async def opened(endpoint: str) -> AsyncIterator[Gateway]:
    gateway = Gateway(endpoint)
    async with gateway.link:
        await gateway.link.join()
        yield gateway


class Agent:
    """A Zenoh session that plays an agent; it keeps its declarations, which end when nobody holds them."""

    def __init__(self, session: zenoh.Session) -> None:
        self.session = session
        self._kept: list[object] = []

    def put(self, key: str, payload: bytes) -> None:
        """Publish once the gateway is known to listen: before that the session of a client sends to nobody."""
        publisher = self.session.declare_publisher(key)
        eventually(lambda: publisher.matching_status.matching, f"somebody who listens to {key}")
        publisher.put(payload)
        publisher.undeclare()

    def declare(self, token: str) -> None:
        self._kept.append(self.session.liveliness().declare_token(token))

    def answer(self, key: str, payload: bytes) -> None:
        self._kept.append(self.session.declare_queryable(key, lambda query: query.reply(key, payload)))

    def be(self, said: bytes, robot: str = "r", incarnation: int = 1) -> None:
        self.answer(KEYS.robot(robot, "description"), said)
        self.declare(KEYS.presence(robot, incarnation))


@contextlib.contextmanager
def session(endpoint: str) -> Iterator[Agent]:
    with stage(endpoint) as opened:
        yield Agent(opened)


def description(robot: str = "r", incarnation: int = 1) -> Description:
    return Description(
        version=WIRE_VERSION,
        robot=robot,
        incarnation=incarnation,
        title=robot,
        urdf=URDF,
        joints=(),
        rate_hz=50,
        layout=layout(0, False),
    )


def frame(sequence: int) -> bytes:
    return encode_state(
        State(incarnation=1, sequence=sequence, monotonic_ns=1, wall_ns=1, positions=(), velocities=(), efforts=())
    )


def command() -> Command:
    return Command(
        version=WIRE_VERSION,
        id="c1",
        incarnation=1,
        seen_ns=0,
        time_to_live_ns=1_000_000_000,
        motion=Move({"elbow": 0.5}),
    )


async def _life(endpoint: str) -> None:
    async with opened(endpoint) as gateway:
        with session(endpoint) as agent:
            agent.be(encode(description("ürobot/1")), "ürobot/1")
            await gateway.seen(Described(description("ürobot/1")))
            assert gateway.events[0] == Appeared("ürobot/1", 1)
            agent.put(KEYS.robot("ürobot/1", "state"), frame(3))
            await gateway.seen(Framed("ürobot/1", frame(3)))
        await gateway.seen(Vanished("ürobot/1", 1))


def test_a_robot_appears_is_described_sends_frames_and_vanishes(endpoint: str) -> None:
    run(_life, endpoint)


async def _restart(endpoint: str) -> None:
    async with contextlib.AsyncExitStack() as stack:
        async with opened(endpoint) as first:
            agent = stack.enter_context(session(endpoint))
            agent.be(encode(description()))
            await first.seen(Described(description()))
        async with opened(endpoint) as second:
            await second.seen(Described(description()))


def test_a_restarted_gateway_finds_running_agents_again(endpoint: str) -> None:
    run(_restart, endpoint)


async def _foreign(endpoint: str) -> None:
    async with opened(endpoint) as gateway:
        with session(endpoint) as agent:
            agent.be(encode(replace_version(description())))
            await gateway.until(lambda: any(isinstance(event, Undescribed) for event in gateway.events))
            reason = next(event.reason for event in gateway.events if isinstance(event, Undescribed))
            assert "wire version 99" in reason
            assert not any(isinstance(event, Described) for event in gateway.events)


def replace_version(said: Description) -> Description:
    return Description(**{name: getattr(said, name) for name in said.__struct_fields__} | {"version": 99})


def test_a_description_of_a_foreign_version_is_told_with_its_reason(endpoint: str) -> None:
    run(_foreign, endpoint)


async def _two_runs(endpoint: str) -> None:
    async with opened(endpoint) as gateway:
        with session(endpoint) as old, session(endpoint) as new:
            old.be(encode(description(incarnation=1)), incarnation=1)
            new.be(encode(description(incarnation=2)), incarnation=2)
            await gateway.seen(Described(description(incarnation=1)))
            await gateway.seen(Described(description(incarnation=2)))


def test_each_of_two_runs_of_one_robot_gets_its_own_description(endpoint: str) -> None:
    run(_two_runs, endpoint)


async def _impostor(endpoint: str) -> None:
    async with opened(endpoint) as gateway:
        with session(endpoint) as agent:
            agent.be(encode(description("another")))
            await gateway.until(lambda: any(isinstance(event, Undescribed) for event in gateway.events))
            assert "another" in next(event.reason for event in gateway.events if isinstance(event, Undescribed))


def test_a_description_of_another_robot_is_refused(endpoint: str) -> None:
    run(_impostor, endpoint)


async def _rubbish(endpoint: str) -> None:
    async with opened(endpoint) as gateway:
        with session(endpoint) as agent:
            agent.declare(f"{KEYS.namespace}/robot/~zz/presence/1")
            agent.declare(f"{KEYS.namespace}/robot/r/presence/x")
            agent.put(f"{KEYS.namespace}/robot/~zz/state", b"")
            agent.put(KEYS.robot("big", "state"), bytes(70_000))
            agent.put(KEYS.robot("r", "progress"), b"{")
            news = Progress(version=WIRE_VERSION, id="c1", incarnation=1, state="running", wall_ns=1)
            agent.put(KEYS.robot("r", "progress"), encode(news))
            await gateway.until(lambda: ("r", news) in gateway.progress and len(gateway.link.malformed) == 5)
            assert not gateway.events
            assert gateway.link.malformed["big"] == gateway.link.malformed["r"] == 1


def test_foreign_keys_and_malformed_payloads_are_counted_and_harmless(endpoint: str) -> None:
    run(_rubbish, endpoint)


@pytest.mark.parametrize("reply", [Accepted("c1"), Refused("c1", "limits", "too far; -1 to 1 would do")])
def test_the_reply_of_the_agent_comes_back(endpoint: str, reply: Reply) -> None:
    async def replied() -> None:
        async with opened(endpoint) as gateway:
            with session(endpoint) as agent:
                agent.answer(KEYS.robot("r", "command"), encode(reply))
                agent.be(encode(description()))
                await gateway.seen(Described(description()))
                assert await gateway.link.command("r", command(), 5) == reply

    run(replied)


def test_the_reply_of_the_meant_run_wins_over_that_of_another(endpoint: str) -> None:
    async def replied() -> None:
        async with opened(endpoint) as gateway:
            with session(endpoint) as old, session(endpoint) as new:
                old.answer(KEYS.robot("r", "command"), encode(Refused("c1", "incarnation", "not me")))
                new.answer(KEYS.robot("r", "command"), encode(Accepted("c1")))
                old.be(encode(description()))
                new.be(encode(description(incarnation=2)), incarnation=2)
                await gateway.seen(Described(description()))
                await gateway.seen(Described(description(incarnation=2)))
                assert await gateway.link.command("r", command(), 5) == Accepted("c1")

    run(replied)


@pytest.mark.parametrize("payload", [b"", b"[]", encode(Accepted("other")), bytes(70_000)])
def test_an_invalid_reply_is_no_answer(endpoint: str, payload: bytes) -> None:
    async def replied() -> None:
        async with opened(endpoint) as gateway:
            with session(endpoint) as agent:
                agent.answer(KEYS.robot("r", "command"), payload)
                agent.be(encode(description()))
                await gateway.seen(Described(description()))
                with pytest.raises(NoAnswer, match="the answer"):
                    await gateway.link.command("r", command(), 5)

    run(replied)


def test_without_an_agent_there_is_no_answer(endpoint: str) -> None:
    async def silent() -> None:
        async with opened(endpoint) as gateway:
            with pytest.raises(NoAnswer, match="no agent"):
                await gateway.link.command("r", command(), 5)

    run(silent)


def test_an_agent_that_keeps_silent_is_no_answer(endpoint: str) -> None:
    async def silent() -> None:
        held: list[zenoh.Query] = []
        async with opened(endpoint) as gateway:
            with session(endpoint) as agent:
                queryable = agent.session.declare_queryable(KEYS.robot("r", "command"), held.append)
                agent.be(encode(description()))
                await gateway.seen(Described(description()))
                with pytest.raises(NoAnswer, match="did not answer within"):
                    await gateway.link.command("r", command(), 0.2)
                held.clear()
                queryable.undeclare()

    run(silent)


def test_a_taken_port_is_one_clear_line(endpoint: str) -> None:
    async def taken() -> None:
        async with opened(endpoint):
            with pytest.raises(LinkError, match="is taken by another process") as caught:
                async with Gateway(endpoint).link:
                    pass
            assert "\n" not in str(caught.value)

    run(taken)


def test_an_endpoint_that_means_nothing_is_one_clear_line() -> None:
    async def opens() -> None:
        with pytest.raises(LinkError, match="Zenoh does not open"):
            async with Gateway("tcp/127.0.0.1:port").link:
                pass

    run(opens)


def test_agents_see_the_gateway_while_it_is_there(endpoint: str) -> None:
    async def seen() -> None:
        async with opened(endpoint):
            with session(endpoint) as agent:
                tokens = await asyncio.to_thread(
                    lambda: list(agent.session.liveliness().get(KEYS.all_gateways, timeout=5.0))
                )
                assert [str(reply.ok.key_expr) for reply in tokens if reply.ok] == [KEYS.gateway("g")]

    run(seen)


def test_heartbeats_come_while_the_event_loop_runs_and_at_no_other_time(endpoint: str) -> None:
    async def beats() -> None:
        async with opened(endpoint) as gateway:
            with session(endpoint) as agent:
                heard: list[zenoh.Sample] = []
                kept = agent.session.declare_subscriber(KEYS.all_heartbeats, heard.append)
                await asyncio.to_thread(eventually, lambda: len(heard) > 2, "heartbeats")
                before = len(heard)
                time.sleep(5 * HEARTBEAT_S)  # noqa: ASYNC251 - the event loop hangs
                assert len(heard) <= before + 1  # which was under way
                await asyncio.to_thread(eventually, lambda: len(heard) > before + 2, "heartbeats afterwards")
                kept.undeclare()
                assert gateway.link.joined

    run(beats)


def test_a_robot_that_comes_is_sent_a_heartbeat_at_once(endpoint: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """It need not wait for the next: here none would come within the time of the test."""
    monkeypatch.setattr(heartbeat, "HEARTBEAT_S", 3600.0)

    async def come() -> None:
        async with opened(endpoint):
            with session(endpoint) as agent:
                heard: list[str] = []
                kept = agent.session.declare_subscriber(
                    KEYS.all_heartbeats, lambda sample: heard.append(str(sample.key_expr))
                )
                agent.declare(KEYS.presence("r", 1))
                await asyncio.to_thread(eventually, lambda: heard, "a heartbeat")
                assert heard == [KEYS.heartbeat("g")]
                kept.undeclare()

    run(come)


async def _roll_call_of_many(endpoint: str) -> None:
    names = {f"r{number}" for number in range(300)}  # more than a channel of Zenoh holds
    async with opened(endpoint) as gateway:
        with session(endpoint) as agent:
            for name in names:
                agent.declare(KEYS.presence(name, 1))
            for name in names:
                await gateway.seen(Appeared(name, 1))
            assert await gateway.link.roll_call(2.0) == names


def test_a_roll_call_hears_of_all_robots_however_many(endpoint: str) -> None:
    run(_roll_call_of_many, endpoint)
