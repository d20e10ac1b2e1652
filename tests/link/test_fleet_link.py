"""The gateway's link: events, replies and error reports from agents' messages."""

import asyncio
import contextlib
from collections.abc import AsyncIterator, Callable

import pytest

from link.parts import Memory, Network, contract
from linked_fleet_agent.transport import Query, Session
from linked_fleet_agent.wire.codec import encode, encode_state, layout
from linked_fleet_agent.wire.keys import Keys
from linked_fleet_agent.wire.messages import (
    WIRE_VERSION,
    Accepted,
    Command,
    Condition,
    Description,
    Move,
    Progress,
    Refused,
    Reply,
    State,
    Stop,
)
from linked_fleet_link.fleet_link import ASK_AGAIN_S, FleetLink, NoAnswer
from linked_fleet_link.transport import Answer, Question
from linked_fleet_state.events import (
    Appeared,
    Conditioned,
    Described,
    DescriptionRejected,
    Event,
    Framed,
    Vanished,
)
from serving import until

KEYS = Keys("site/hall-2")
URDF = "<robot name='r'><link name='base'/></robot>"
in_memory = pytest.mark.parametrize("part", [Memory])


class Gateway:
    """Collects the reports of the link, and wakes waiting coroutines."""

    def __init__(self, part: Network) -> None:
        self.events: list[Event] = []
        self.progress: list[tuple[str, Progress]] = []
        self._changed = asyncio.Event()
        self.link = FleetLink(KEYS, "g", part.gateway, self._on_events, self._on_progress)

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

    async def complaint(self) -> str:
        """Return the reason why a robot has no description."""
        await self.until(lambda: any(isinstance(event, DescriptionRejected) for event in self.events))
        assert not any(isinstance(event, Described) for event in self.events)
        return next(event.reason for event in self.events if isinstance(event, DescriptionRejected))


@contextlib.asynccontextmanager
async def opened(part: Network) -> AsyncIterator[Gateway]:
    gateway = Gateway(part)
    async with gateway.link:
        await gateway.link.join()
        yield gateway


class Agent:
    """Plays an agent on a session; its declarations last as long as the session."""

    def __init__(self, part: Network, session: Session) -> None:
        self._part, self._session = part, session

    def answer(self, key: str, payload: bytes) -> None:
        self.take(key, lambda query: query.reply(key, payload))

    def take(self, key: str, answer: Callable[[Query], None]) -> None:
        self._part.keep(self._session.declare_queryable(key, answer))

    def appear(self, token: str) -> None:
        self._part.keep(self._session.declare_token(token))

    def be(self, said: Description, payload: bytes | None = None) -> None:
        self.answer(KEYS.robot(said.robot, "description"), payload or encode(said))
        self.appear(KEYS.presence(said.robot, said.incarnation))

    def publish(self, key: str, payload: bytes) -> None:
        with self._session.declare_publisher(key, reliable=True, express=True) as publisher:
            publisher.put(payload)


async def play(part: Network, name: str = "r") -> Agent:
    return Agent(part, await part.agent(name))


def description(robot: str = "r", incarnation: int = 1, version: int = WIRE_VERSION) -> Description:
    return Description(
        version=version, robot=robot, incarnation=incarnation, title=robot, urdf=URDF, joints=(), rate_hz=50,
        layout=layout(0, False),
    )  # fmt: skip


def frame(sequence: int) -> bytes:
    return encode_state(
        State(incarnation=1, sequence=sequence, monotonic_ns=1, wall_ns=1, positions=(), velocities=(), efforts=())
    )


def command() -> Command:
    return Command(
        version=WIRE_VERSION, id="c1", incarnation=1, seen_ns=0, time_to_live_ns=10**9, motion=Move({"elbow": 0.5})
    )


# -- who is there ---------------------------------------------------------------------------------------------------


@contract
async def test_a_robot_appears_is_described_sends_frames_and_vanishes(part: Network) -> None:
    name = "ürobot/1"
    async with opened(part) as gateway:
        agent = await play(part)
        agent.be(description(name))
        await gateway.seen(Described(description(name)))
        assert gateway.events[0] == Appeared(name, 1)
        assert gateway.link.is_connected
        assert await gateway.link.list_robots(5.0) == {name}
        # an agent publishes to nobody before it knows its subscribers
        while Framed(name, frame(3)) not in gateway.events:
            agent.publish(KEYS.robot(name, "state"), frame(3))
            await asyncio.sleep(0.01)
        await part.leave("r")
        await gateway.seen(Vanished(name, 1))
    assert not gateway.link.malformed_counts


@in_memory
@contract
async def test_a_description_of_a_foreign_version_is_told_with_its_reason(part: Network) -> None:
    async with opened(part) as gateway:
        (await play(part)).be(description(version=99))
        assert "wire version 99" in await gateway.complaint()


@in_memory
@contract
async def test_a_description_of_another_robot_is_refused(part: Network) -> None:
    async with opened(part) as gateway:
        (await play(part)).be(description(), encode(description("another")))
        assert "another" in await gateway.complaint()


@in_memory
@contract
async def test_each_of_two_runs_of_one_robot_gets_its_own_description(part: Network) -> None:
    async with opened(part) as gateway:
        for run in (1, 2):
            (await play(part, f"run {run}")).be(description(incarnation=run))
        await gateway.seen(Described(description(incarnation=1)))
        await gateway.seen(Described(description(incarnation=2)))


@in_memory
@contract
async def test_a_gateway_receives_robots_that_see_it(part: Memory) -> None:
    gateway = Gateway(part)
    async with gateway.link:
        session = await part.agent("r")
        part.network.set_faults(latency_s=(0.0, 0.05))
        agent = Agent(part, session)
        news = Progress(version=WIRE_VERSION, id="c1", incarnation=1, state="running", wall_ns=1)

        condition = Condition(version=WIRE_VERSION, incarnation=1, fault="cable out")

        def meet(key: str, present: bool) -> None:
            agent.publish(KEYS.robot("r", "progress"), encode(news))
            agent.publish(KEYS.robot("r", "state"), frame(3))
            agent.publish(KEYS.robot("r", "condition"), encode(condition))

        part.keep(session.subscribe_tokens(KEYS.all_gateways, meet))
        agent.be(description())
        await gateway.link.join()
        await gateway.until(lambda: ("r", news) in gateway.progress)
        await gateway.seen(Framed("r", frame(3)))
        await gateway.seen(Conditioned("r", condition))


@in_memory
@contract
async def test_a_token_that_is_declared_again_at_once_has_not_gone(part: Network) -> None:
    async with opened(part) as gateway:
        session = await part.agent("r")
        part.keep(session.declare_queryable(KEYS.robot("r", "description"), lambda query: None))
        token = KEYS.presence("r", 1)
        for _ in range(3):
            with session.declare_token(token):
                await gateway.seen(Appeared("r", 1))
                await asyncio.sleep(0.1)
        await gateway.seen(Vanished("r", 1))
        await asyncio.sleep(1)
        assert [event for event in gateway.events if not isinstance(event, DescriptionRejected)] == [
            Appeared("r", 1),
            Vanished("r", 1),
        ]


@in_memory
@contract
async def test_a_robot_that_comes_is_sent_a_heartbeat_at_once(part: Network) -> None:
    """It need not wait for the next one."""
    async with opened(part):
        session, heard = await part.agent("r"), list[str]()
        part.keep(session.subscribe(KEYS.all_heartbeats, heard.append))
        await until(lambda: len(heard) == 3)
        await asyncio.sleep(0.1)
        part.keep(session.declare_token(KEYS.presence("r", 1)))
        await asyncio.sleep(0.1)
        assert heard == [KEYS.heartbeat("g")] * 4


@contract
async def test_foreign_keys_and_malformed_payloads_are_counted_and_harmless(part: Network) -> None:
    news = Progress(version=WIRE_VERSION, id="c1", incarnation=1, state="running", wall_ns=1)
    async with opened(part) as gateway:
        agent = await play(part)
        agent.appear(f"{KEYS.namespace}/robot/~zz/presence/1")
        agent.appear(f"{KEYS.namespace}/robot/r/presence/x")
        while not gateway.progress:
            agent.publish(KEYS.robot("r", "progress"), encode(news))
            await asyncio.sleep(0.01)
        agent.publish(f"{KEYS.namespace}/robot/~zz/state", b"")
        agent.publish(KEYS.robot("big", "state"), bytes(70_000))
        agent.publish(KEYS.robot("r", "progress"), b"{")
        await until(lambda: len(gateway.link.malformed_counts) == 5)
        assert gateway.link.malformed_counts["big"] == gateway.link.malformed_counts["r"] == 1
        assert not gateway.events
        assert set(map(str, gateway.progress)) == {str(("r", news))}


# -- what is asked of them ------------------------------------------------------------------------------------------


@contextlib.asynccontextmanager
async def answering(part: Network, *replies: bytes) -> AsyncIterator[Gateway]:
    """Yield a gateway that knows a robot with one run per reply to a command."""
    async with opened(part) as gateway:
        for run, reply in enumerate(replies, 1):
            agent = await play(part, f"run {run}")
            agent.answer(KEYS.robot("r", "command"), reply)
            agent.be(description(incarnation=run))
            await gateway.seen(Described(description(incarnation=run)))
        yield gateway


@contract
@pytest.mark.parametrize("reply", [Accepted("c1"), Refused("c1", "limits", "too far; -1 to 1 would do")])
async def test_the_reply_of_the_agent_comes_back(part: Network, reply: Reply) -> None:
    async with answering(part, encode(reply)) as gateway:
        for _ in range(2):  # the second time with a cached route
            assert await gateway.link.command("r", command(), 5) == reply


@in_memory
@contract
@pytest.mark.parametrize("turn", [1, -1])
async def test_the_reply_of_the_meant_run_wins_over_that_of_another(part: Network, turn: int) -> None:
    replies = [encode(Refused("c1", "incarnation", "not me")), encode(Accepted("c1"))]
    async with answering(part, *replies[::turn]) as gateway:
        assert await gateway.link.command("r", command(), 5) == Accepted("c1")


@in_memory
@contract
async def test_the_refusal_of_another_run_is_a_reply_where_there_is_no_better(part: Network) -> None:
    refused = Refused("c1", "incarnation", "not me")
    async with answering(part, encode(refused)) as gateway:
        assert await gateway.link.command("r", command(), 5) == refused


@in_memory
@contract
@pytest.mark.parametrize("payload", [b"", b"[]", encode(Accepted("other")), bytes(70_000)])
async def test_an_invalid_reply_is_no_answer(part: Network, payload: bytes) -> None:
    async with answering(part, payload) as gateway:
        with pytest.raises(NoAnswer, match="the answer"):
            await gateway.link.command("r", command(), 5)


@in_memory
@contract
async def test_without_an_agent_there_is_no_answer(part: Network) -> None:
    async with opened(part) as gateway:
        with pytest.raises(NoAnswer, match="no agent"):
            await gateway.link.command("r", command(), 5)


@contract
async def test_an_agent_that_keeps_silent_is_no_answer(part: Network) -> None:
    held: list[Query] = []
    async with opened(part) as gateway:
        agent = await play(part)
        agent.take(KEYS.robot("r", "command"), held.append)
        agent.be(description())
        await gateway.seen(Described(description()))
        with pytest.raises(NoAnswer, match="did not answer within"):
            await gateway.link.command("r", command(), 0.2)
        assert held
        held.clear()


@in_memory
@contract
async def test_a_stop_of_all_waits_for_no_robot_that_is_silent(part: Network) -> None:
    async with opened(part) as gateway:
        for name in ("a", "b", "silent"):
            agent, key = await play(part, name), KEYS.robot(name, "stop")
            if name == "silent":
                agent.take(key, part.keep)
            else:
                agent.answer(key, encode(Accepted("s")))
            agent.be(description(name))
            await gateway.seen(Described(description(name)))
        stop = Stop(version=WIRE_VERSION, id="s")
        assert await gateway.link.stop(None, stop, 1.0) == {"a": Accepted("s"), "b": Accepted("s")}
        assert await gateway.link.stop(["a", "silent", "nobody"], stop, 1.0) == {"a": Accepted("s")}
        assert await gateway.link.stop((), stop, 1.0) == {}


@contract
async def test_a_stop_is_answered_while_more_commands_wait_than_there_are_threads(part: Network) -> None:
    held: list[Query] = []
    async with opened(part) as gateway:
        agent, key = await play(part), KEYS.robot("r", "command")
        agent.take(key, held.append)
        agent.answer(KEYS.robot("r", "stop"), encode(Accepted("s")))
        agent.be(description())
        await gateway.seen(Described(description()))
        # One after another: a congested connection may drop some of forty at once, or of their answers.
        waiting: list[asyncio.Task[Reply]] = []
        for _ in range(40):
            waiting.append(asyncio.create_task(gateway.link.command("r", command(), 20.0)))
            await until(lambda: len(held) == len(waiting))
        assert await gateway.link.stop(["r"], Stop(version=WIRE_VERSION, id="s"), 20.0) == {"r": Accepted("s")}
        while held:
            held.pop().reply(key, encode(Accepted("c1")))
            await until(lambda: sum(each.done() for each in waiting) == len(waiting) - len(held))
        assert await asyncio.gather(*waiting) == [Accepted("c1")] * len(waiting)


@in_memory
@contract
@pytest.mark.parametrize("named", [True, False])
async def test_a_stop_reaches_a_robot_that_declares_itself_anew_at_that_moment(part: Network, named: bool) -> None:
    async with opened(part) as gateway:
        session, key = await part.agent("r"), KEYS.robot("r", "stop")
        agent = Agent(part, session)
        agent.be(description())
        await gateway.seen(Described(description()))
        stop = Stop(version=WIRE_VERSION, id="s")
        robots = ["r"] if named else None
        asked = asyncio.create_task(gateway.link.stop(robots, stop, 1.0, () if named else ["r"]))
        await asyncio.sleep(ASK_AGAIN_S / 2)
        agent.answer(key, encode(Accepted("s")))
        assert await asked == {"r": Accepted("s")}


@in_memory
@contract
async def test_a_stop_of_one_robot_waits_for_a_congested_connection(
    part: Network, monkeypatch: pytest.MonkeyPatch
) -> None:
    async with opened(part) as gateway:
        agent = await play(part)
        agent.be(description())
        await gateway.seen(Described(description()))
        agent.answer(KEYS.robot("r", "stop"), encode(Accepted("s")))
        session, patience = gateway.link._session, list[bool]()
        send = session.ask

        async def congested(question: Question, hear: Callable[[Answer | None], None]) -> float:
            patience.append(question.blocking)
            return await send(question, hear) if question.blocking else 0.0

        monkeypatch.setattr(session, "ask", congested)
        assert await gateway.link.stop(["r"], Stop(version=WIRE_VERSION, id="s"), 1.0) == {"r": Accepted("s")}
        assert patience == [False, True]


@in_memory
@contract
@pytest.mark.parametrize("reply", [Accepted("c1"), Refused("c1", "limits", "too far")])
async def test_a_command_reaches_a_robot_that_declares_itself_anew_at_that_moment(part: Network, reply: Reply) -> None:
    async with opened(part) as gateway:
        agent, key = await play(part), KEYS.robot("r", "command")
        agent.be(description())
        await gateway.seen(Described(description()))
        asked = asyncio.create_task(gateway.link.command("r", command(), 1.0))
        await asyncio.sleep(ASK_AGAIN_S / 2)
        agent.answer(key, encode(reply))
        assert await asked == reply


@in_memory
@contract
async def test_a_command_whose_reply_was_lost_is_no_answer(part: Network) -> None:
    async with opened(part) as gateway:
        agent, key = await play(part), KEYS.robot("r", "command")
        agent.be(description())
        await gateway.seen(Described(description()))
        asked = asyncio.create_task(gateway.link.command("r", command(), 1.0))
        await asyncio.sleep(ASK_AGAIN_S / 2)
        agent.answer(key, encode(Refused("c1", "repeated", "it has been taken")))
        with pytest.raises(NoAnswer, match="its reply was lost"):
            await asked
