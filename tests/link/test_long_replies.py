"""Long replies in parts: between new and old agents and gateways, interrupted, and on slow links."""

import asyncio
import random
import time
from collections.abc import Callable
from contextlib import AsyncExitStack
from typing import Any

import pytest

import linked_fleet_agent.zenoh_session
import linked_fleet_link.zenoh_session
from forwarder import proxy
from link.parts import Memory, Network, contract
from link.test_contract import asked
from link.test_robot_link import in_memory, link, until_listed
from linked_fleet_agent.long_replies import LongReplies as HeldReplies
from linked_fleet_agent.long_replies import part_of
from linked_fleet_agent.transport import Query
from linked_fleet_agent.wire.keys import Keys
from linked_fleet_agent.wire.parts import PART_BYTES, PartRequest, content_tag
from linked_fleet_link import long_replies
from linked_fleet_link.long_replies import MAX_TRANSFER_S, PART_TIMEOUT_S, LongReplies
from linked_fleet_link.transport import Question, Session, ask
from running import free_port
from serving import until

KEYS = Keys("site/hall-2")
MESH, DESCRIPTION = KEYS.robot("r", "mesh"), KEYS.robot("r", "description")
LENGTHS = [0, 1, PART_BYTES - 1, PART_BYTES, PART_BYTES + 1, 5 * PART_BYTES + 7]


def content_of(length: int) -> bytes:
    return random.Random(length).randbytes(length)


def about(key: str, payload: bytes | None = b"digest", limit: int = 10**8) -> Question:
    return Question(key, payload, 15.0, limit, priority="background")


def whole(said: bytes | str, _: str) -> bytes | str:
    return said


class PartsSeen:
    """Answers of a handler of meshes, and the parts that were asked for."""

    def __init__(self, part: Network, session: Any, answer: Callable[[Query], None]) -> None:
        self.asked: list[PartRequest | None] = []
        self._answer = answer
        part.keep(session.declare_queryable(MESH, self._take))

    def _take(self, query: Query) -> None:
        self.asked.append(query.part)
        self._answer(query)


@pytest.mark.parametrize("length", LENGTHS)
@pytest.mark.parametrize("kind", ["mesh", "picture", "description"])
@contract
async def test_a_reply_of_any_length_arrives_in_parts(part: Network, kind: Any, length: int) -> None:
    gateway, session, content = await part.gateway(), await part.agent("r"), content_of(length)
    async with link(session, description=content, on_mesh=lambda _: content, on_picture=lambda _: content):
        await until_listed(gateway, 1)
        assert await LongReplies(gateway).ask(about(KEYS.robot("r", kind)), whole) == content


@pytest.mark.parametrize("length", LENGTHS)
@contract
async def test_an_agent_of_an_earlier_release_sends_the_whole_reply_once(part: Network, length: int) -> None:
    gateway, session, content = await part.gateway(), await part.agent("r"), content_of(length)
    seen = PartsSeen(part, session, lambda query: query.reply(MESH, content))
    async with link(session):
        await until_listed(gateway, 1)
        assert await LongReplies(gateway).ask(about(MESH), whole) == content
        assert len(seen.asked) == 1


@pytest.mark.parametrize("kind", ["mesh", "picture", "description"])
@contract
async def test_a_gateway_of_an_earlier_release_gets_the_whole_reply(part: Network, kind: Any) -> None:
    gateway, session, content = await part.gateway(), await part.agent("r"), content_of(LENGTHS[-1])
    async with link(session, description=content, on_mesh=lambda _: content, on_picture=lambda _: content):
        await until_listed(gateway, 1)
        (answer,) = await asked(gateway, about(KEYS.robot("r", kind)))
        assert answer.payload == content
        assert answer.head is None


@in_memory
@contract
async def test_two_runs_that_answer_at_once_are_not_mixed(part: Memory) -> None:
    gateway, contents = await part.gateway(), [content_of(3 * PART_BYTES), content_of(3 * PART_BYTES + 1)]
    sessions = [await part.agent(f"run {run}") for run in (1, 2)]
    links = [link(session, run, description=contents[run - 1]) for run, session in enumerate(sessions, 1)]
    for each in links:
        each._declare()
    await asyncio.sleep(0.1)
    said = list[bytes | str]()

    def judge(answer: bytes | str, _: str) -> bool | None:
        said.append(answer)
        return True if contents[1] in said else None

    assert await LongReplies(gateway).ask(about(DESCRIPTION, None), judge)
    assert set(said) <= set(contents)
    for each in links:
        each._undeclare()


@in_memory
@contract
async def test_an_interrupted_reply_is_resumed(part: Memory) -> None:
    gateway, session, content = await part.gateway(), await part.agent("r"), content_of(40 * PART_BYTES)
    read, replies = list[bytes](), LongReplies(gateway)

    def mesh(question: bytes) -> bytes:
        read.append(question)
        return content

    async with link(session, on_mesh=mesh):
        await until_listed(gateway, 1)
        part.network.set_faults(latency_s=(0.05, 0.05))
        asyncio.get_running_loop().call_later(1.5, part.cut, "r")
        with pytest.raises(TimeoutError, match=r"\d+ of 2621440 bytes arrived"):
            await replies.ask(about(MESH), whole)
        part.heal("r")
        await until_listed(gateway, 1)
        begun = asyncio.get_running_loop().time()
        assert await replies.ask(about(MESH), whole) == content
        resumed_s = asyncio.get_running_loop().time() - begun
        begun = asyncio.get_running_loop().time()
        assert await replies.ask(about(MESH), whole) == content
        assert resumed_s < 0.8 * (asyncio.get_running_loop().time() - begun)


@in_memory
@contract
async def test_a_changed_content_begins_anew(part: Memory) -> None:
    """An agent that has started again since may have other bytes under the same name."""
    gateway, session, replies = await part.gateway(), await part.agent("r"), LongReplies(await part.gateway())
    before, behind = content_of(40 * PART_BYTES), content_of(3 * PART_BYTES)
    contents = [before]
    async with link(session, on_mesh=lambda _: contents[-1]) as robot:
        await until_listed(gateway, 1)
        await asyncio.sleep(2)
        part.network.set_faults(latency_s=(0.05, 0.05))
        asking = asyncio.create_task(replies.ask(about(MESH), whole))
        await asyncio.sleep(1.0)
        asking.cancel()
        await asyncio.wait([asking])
        contents.append(behind)
        robot._slow["mesh"].replies = HeldReplies()
        said = list[bytes | str]()
        assert await replies.ask(
            about(MESH), lambda answer, _: said.append(answer) or answer if answer == behind else None
        )
        assert said == [behind]


def drop_every(count: int, content: bytes) -> Callable[[Query], None]:
    """Return an answer that drops one part of ``count``, as congestion does."""
    numbers = iter(range(10**6))

    def answer(query: Query) -> None:
        asked = query.part
        if asked is None or next(numbers) % count == 1:
            return
        query.reply(MESH, *part_of(content, content_tag(content), asked))

    return answer


@in_memory
@contract
async def test_dropped_parts_are_asked_for_again(part: Memory) -> None:
    gateway, session, content = await part.gateway(), await part.agent("r"), content_of(10 * PART_BYTES)
    seen = PartsSeen(part, session, drop_every(3, content))
    async with link(session):
        await until_listed(gateway, 1)
        assert await LongReplies(gateway).ask(about(MESH), whole) == content
        lengths = [each.length for each in seen.asked if each is not None]
        assert max(lengths) <= long_replies.LONGEST_BYTES


@in_memory
@contract
async def test_a_sender_of_single_bytes_is_given_up(part: Memory) -> None:
    gateway, session = await part.gateway(), await part.agent("r")

    def answer(query: Query) -> None:
        assert query.part is not None
        query.reply(MESH, *part_of(content_of(10**6), content_tag(b""), query.part._replace(tag="", length=1)))

    PartsSeen(part, session, answer)
    async with link(session):
        await until_listed(gateway, 1)
        part.network.set_faults(latency_s=(0.5, 0.5))
        begun = asyncio.get_running_loop().time()
        with pytest.raises(TimeoutError, match="the most is 120 s"):
            await LongReplies(gateway).ask(about(MESH), whole)
        assert MAX_TRANSFER_S <= asyncio.get_running_loop().time() - begun < MAX_TRANSFER_S + PART_TIMEOUT_S


@in_memory
@contract
async def test_a_content_above_the_limit_is_refused_with_its_length(part: Memory) -> None:
    gateway, session = await part.gateway(), await part.agent("r")
    async with link(session, on_mesh=lambda _: content_of(3 * PART_BYTES)):
        await until_listed(gateway, 1)
        said = await LongReplies(gateway).ask(about(MESH, limit=2 * PART_BYTES), whole)
        assert said == "the answer has 196608 bytes; 131072 are the most"


# -- slow links -----------------------------------------------------------------------------------------------------


class SlowLink:
    """Real sessions of a gateway and an agent on a slow link: tokens, ages of states and durations of stops."""

    def __init__(self, gateway: Session) -> None:
        self.gateway = gateway
        self.tokens: list[bool] = []
        self.ages_s: list[float] = []
        self.stops_s: list[float] = []

    async def listen(self) -> None:
        await self.gateway.subscribe_tokens(KEYS.all_presence, lambda _, present: self.tokens.append(present))
        await self.gateway.subscribe(KEYS.all_states, 100, self._hear)

    def _hear(self, _: str, payload: Any) -> None:
        self.ages_s.append(time.monotonic() - float(payload))

    async def stop_forever(self) -> None:
        while True:
            begun = time.monotonic()
            question = Question(KEYS.robot("r", "stop"), b"x", 20.0, 100, priority="real time")
            await ask(self.gateway, question, whole)
            self.stops_s.append(time.monotonic() - begun)
            await asyncio.sleep(0.2)


async def publish_forever(robot: Any) -> None:
    while True:
        robot.publish_state(str(time.monotonic()).encode())
        await asyncio.sleep(0.02)


@pytest.mark.processes
@pytest.mark.parametrize(
    ("bytes_per_s", "delay_s", "size"),
    [
        pytest.param(250_000, 0.03, 1_600_000, id="2 Mbit/s"),
        pytest.param(2_500_000, 0.06, 6_230_755, id="20 Mbit/s, 60 ms", marks=pytest.mark.test_all),
        pytest.param(625_000, 0.03, 6_230_755, id="5 Mbit/s", marks=pytest.mark.test_all),
    ],
)
def test_a_mesh_over_a_slow_link_costs_neither_session_nor_stops(bytes_per_s: float, delay_s: float, size: int) -> None:
    """It needs more than the five seconds after which Zenoh closes a session whose message waits."""
    asyncio.run(fetch_slowly(bytes_per_s, delay_s, content_of(size)))


async def fetch_slowly(bytes_per_s: float, delay_s: float, content: bytes) -> None:
    port = free_port()
    async with asyncio.timeout(100), AsyncExitStack() as stack:
        gateway = await linked_fleet_link.zenoh_session.open_session((f"tcp/127.0.0.1:{port}",), (), {})
        stack.push_async_callback(gateway.close)
        slow = SlowLink(gateway)
        await slow.listen()
        way = stack.enter_context(proxy(port, bytes_per_s, delay_s))
        opening = linked_fleet_agent.zenoh_session.open_session((way.endpoint,), lease_ms=2000)
        session = await stack.enter_async_context(opening)
        robot = await stack.enter_async_context(link(session, on_mesh=lambda _: content))
        await until(lambda: slow.tokens)
        for work in (publish_forever(robot), slow.stop_forever()):
            stack.callback(asyncio.create_task(work).cancel)
        await until(lambda: slow.ages_s and slow.stops_s)
        assert await LongReplies(gateway).ask(about(MESH), whole) == content
        assert slow.tokens == [True]
        # One part may be ahead of either: a quarter of a second at 2 Mbit/s.
        assert max(slow.ages_s) < 2.0
        assert max(slow.stops_s) < 2.0
