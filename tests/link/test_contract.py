"""The contract of the transport interface below the links, kept by both Zenoh and the in-memory network.

It is tested through the two classes ``Session`` of ``linked_fleet_link.transport`` and
``linked_fleet_agent.transport``.
"""

import asyncio
from contextlib import AbstractContextManager

import pytest

import linked_fleet_agent.transport as agent_side
import linked_fleet_link.transport as gateway_side
from link.parts import Network, contract
from linked_fleet_agent.wire.keys import Keys
from linked_fleet_agent.wire.traceparent import MAX_BYTES
from linked_fleet_link.transport import Answer, Question
from linked_fleet_state.events import Payload
from serving import until

KEYS = Keys("site/hall-2")
STATE, PROGRESS = KEYS.robot("r", "state"), KEYS.robot("r", "progress")
COMMAND, STOP = KEYS.robot("r", "command"), KEYS.robot("r", "stop")
TOKEN, GATEWAY = KEYS.presence("r", 1), KEYS.gateway("g")
LIMIT = 1000


class ReceivedPublications(list[tuple[str, Payload]]):
    """Publications in the order of arrival."""

    def take(self, key: str, payload: Payload) -> None:
        self.append((key, payload))

    def numbers(self, key: str = STATE) -> list[int]:
        return [int(payload) for heard, payload in self if heard == key and isinstance(payload, bytes)]


class Seen(list[tuple[str, bool]]):
    """News of tokens."""

    def take(self, key: str, present: bool) -> None:
        self.append((key, present))

    @property
    def present(self) -> set[str]:
        return {key for key, present in dict(self).items() if present}


async def asked(session: gateway_side.Session, question: Question) -> list[Answer]:
    """Return all answers to a question, after its end."""
    answers: asyncio.Queue[Answer | None] = asyncio.Queue()
    await session.ask(question, answers.put_nowait)
    found = []
    while (answer := await answers.get()) is not None:
        found.append(answer)
    return found


def question(key: str = COMMAND, timeout_s: float = 20.0, payload: bytes | None = None, **more: object) -> Question:
    return Question(key, payload, timeout_s, LIMIT, **more)  # type: ignore[arg-type]


def answers(session: agent_side.Session, key: str, payload: bytes) -> AbstractContextManager[object]:
    return session.declare_queryable(key, lambda query: query.reply(key, payload))


async def met(gateway: gateway_side.Session, agent: agent_side.Session, token: str = "seen") -> None:
    """Wait until the gateway knows everything that the agent has declared so far."""
    seen = Seen()
    key = KEYS.presence(token, 1)
    await gateway.subscribe_tokens(key, seen.take)
    with agent.declare_token(key):
        await until(lambda: seen.present)
    await until(lambda: not seen.present)


async def listening(gateway: gateway_side.Session, agent: agent_side.Session) -> ReceivedPublications:
    """Subscribe as a gateway, and wait until the agent knows it: a client without a subscriber sends nothing."""
    heard = ReceivedPublications()
    await gateway.subscribe_frames(KEYS.all_states, LIMIT, heard.take)
    await gateway.subscribe(KEYS.all_progress, LIMIT, heard.take)
    with (
        agent.declare_publisher(KEYS.robot("early", "state"), reliable=False, express=True) as states,
        agent.declare_publisher(KEYS.robot("early", "progress"), reliable=False, express=True) as progress,
    ):
        while {key for key, _ in heard} != {KEYS.robot("early", "state"), KEYS.robot("early", "progress")}:
            states.put(b"")
            progress.put(b"")
            await asyncio.sleep(0.01)
    return heard


# -- publications ---------------------------------------------------------------------------------------------------


@contract
async def test_frames_of_one_publisher_come_in_their_order_and_once(part: Network) -> None:
    gateway, agent = await part.gateway(), await part.agent("r")
    heard = await listening(gateway, agent)
    with agent.declare_publisher(STATE, reliable=False, express=False) as states:
        for number in range(500):
            states.put(str(number).encode())
            if number % 50 == 0:
                await asyncio.sleep(0)
        await until(lambda: 499 in heard.numbers())
    assert heard.numbers() == sorted(set(heard.numbers()))


@contract
async def test_reliable_messages_arrive_in_order(part: Network) -> None:
    gateway, agent = await part.gateway(), await part.agent("r")
    heard = await listening(gateway, agent)
    with agent.declare_publisher(PROGRESS, reliable=True, express=True) as ends:
        for number in range(500):
            ends.put(str(number).encode())
        await until(lambda: 499 in heard.numbers(PROGRESS))
    assert heard.numbers(PROGRESS) == list(range(500))


@contract
async def test_too_large_payloads_are_reported_by_size(part: Network) -> None:
    gateway, agent = await part.gateway(), await part.agent("r")
    heard = await listening(gateway, agent)
    with (
        agent.declare_publisher(STATE, reliable=True, express=False) as states,
        agent.declare_publisher(PROGRESS, reliable=True, express=True) as progress,
    ):
        for publisher in (states, progress):
            publisher.put(bytes(LIMIT))
            publisher.put(bytes(LIMIT + 1))
        await until(lambda: (PROGRESS, LIMIT + 1) in heard and (STATE, LIMIT + 1) in heard)
    for key in (STATE, PROGRESS):
        assert [payload for heard_key, payload in heard if heard_key == key] == [bytes(LIMIT), LIMIT + 1]


@contract
async def test_a_publisher_that_is_undeclared_or_closed_refuses(part: Network) -> None:
    await part.gateway()
    agent = await part.agent("r")
    with agent.declare_publisher(STATE, reliable=False, express=False) as undeclared:
        pass
    with agent.declare_publisher(STATE, reliable=False, express=False) as closed:
        await part.leave("r")
        for publisher in (undeclared, closed):
            with pytest.raises(agent_side.TransportError):
                publisher.put(b"")


@contract
async def test_heartbeats_reach_agents_under_the_key_of_their_gateway(part: Network) -> None:
    gateway, agent = await part.gateway(), await part.agent("r")
    heard: list[str] = []
    with agent.subscribe(KEYS.all_heartbeats, heard.append):
        beat = gateway.declare_heartbeat(KEYS.heartbeat("g"))
        await met(gateway, agent)
        beat()
        await until(lambda: heard)
    assert heard == [KEYS.heartbeat("g")]
    await gateway.close()
    with pytest.raises(gateway_side.TransportError):
        beat()


# -- questions ------------------------------------------------------------------------------------------------------


@contract
async def test_a_question_and_its_answer_arrive_whole(part: Network) -> None:
    gateway, agent = await part.gateway(), await part.agent("r")
    taken: list[tuple[bytes, bytes | None]] = []

    def answer(query: agent_side.Query) -> None:
        taken.append((query.payload, query.traceparent))
        query.reply(COMMAND, bytes(LIMIT))

    with agent.declare_queryable(COMMAND, answer):
        await met(gateway, agent)
        for priority in ("real time", "data", "background"):
            for blocking in (True, False):
                asking = question(payload=b"move", priority=priority, blocking=blocking, traceparent=b"00-1")
                assert await asked(gateway, asking) == [Answer(bytes(LIMIT), COMMAND)]
        await asked(gateway, question(traceparent=bytes(MAX_BYTES)))
        await asked(gateway, question(traceparent=bytes(MAX_BYTES + 1)))
        await gateway.keep_route(COMMAND)
        assert await asked(gateway, question()) == [Answer(bytes(LIMIT), COMMAND)]
    assert taken == [(b"move", b"00-1")] * 6 + [(b"", bytes(MAX_BYTES)), (b"", None), (b"", None)]


@contract
async def test_too_large_replies_are_reported_by_size(part: Network) -> None:
    gateway, agent = await part.gateway(), await part.agent("r")
    with answers(agent, COMMAND, bytes(LIMIT + 1)):
        await met(gateway, agent)
        assert await asked(gateway, question()) == [Answer(LIMIT + 1, COMMAND)]


@contract
@pytest.mark.parametrize(
    ("said", "error"),
    [
        (b"too much is asked for", "too much is asked for"),
        ("Bär\nund\x1b[31m".encode(), "Bär und [31m"),
        (b"\xff", "\ufffd"),
        (b"x" * 1025, ""),
        (b"", ""),
    ],
)
async def test_a_refusal_has_its_sentence_and_no_payload(part: Network, said: bytes, error: str) -> None:
    gateway, agent = await part.gateway(), await part.agent("r")
    with agent.declare_queryable(COMMAND, lambda query: query.refuse(said)):
        await met(gateway, agent)
        assert await asked(gateway, question()) == [Answer(None, COMMAND, error=error)]


@contract
async def test_a_query_without_queryables_ends_at_once(part: Network) -> None:
    gateway, agent = await part.gateway(), await part.agent("r")
    with answers(agent, STOP, b"of another key"):
        await met(gateway, agent)
        assert await asked(gateway, question()) == []


@contract
async def test_a_question_that_is_dropped_is_over_without_an_answer(part: Network) -> None:
    gateway, agent = await part.gateway(), await part.agent("r")
    with agent.declare_queryable(COMMAND, lambda query: None):
        await met(gateway, agent)
        assert await asked(gateway, question()) == []


@contract
async def test_a_question_that_is_held_ends_with_an_error_when_its_time_is_over(part: Network) -> None:
    gateway, agent = await part.gateway(), await part.agent("r")
    held: list[agent_side.Query] = []
    with agent.declare_queryable(COMMAND, held.append):
        await met(gateway, agent)
        [answer] = await asked(gateway, question(timeout_s=0.2))
        assert (answer.payload, answer.key) == (None, COMMAND)
        assert len(held) == 1
        held.clear()


@contract
async def test_all_matching_queryables_reply_under_their_keys(part: Network) -> None:
    gateway = await part.gateway()
    expected = set()
    for name in ("a", "b", "c"):
        agent, key = await part.agent(name), KEYS.robot(name, "stop")
        part.keep(answers(agent, key, name.encode()))
        expected.add(Answer(name.encode(), key))
        await met(gateway, agent, name)
    found = await asked(gateway, question(KEYS.all_stops, priority="real time"))
    assert (len(found), set(found)) == (3, expected)
    assert await asked(gateway, question(KEYS.robot("b", "stop"))) == [Answer(b"b", KEYS.robot("b", "stop"))]


@contract
async def test_two_runs_under_one_key_both_answer(part: Network) -> None:
    gateway = await part.gateway()
    for run in (b"old", b"new"):
        agent = await part.agent(run.decode())
        part.keep(answers(agent, COMMAND, run))
        await met(gateway, agent, run.decode())
    found = await asked(gateway, question())
    assert sorted(found) == [Answer(b"new", COMMAND), Answer(b"old", COMMAND)]


@contract
async def test_two_queryables_of_one_session_both_answer(part: Network) -> None:
    gateway, agent = await part.gateway(), await part.agent("r")
    for name in ("a", "b"):
        part.keep(answers(agent, KEYS.robot(name, "stop"), name.encode()))
    await met(gateway, agent)
    assert sorted(answer.payload for answer in await asked(gateway, question(KEYS.all_stops))) == [b"a", b"b"]


@contract
async def test_a_question_has_one_reply_and_on_its_own_key(part: Network) -> None:
    gateway, agent = await part.gateway(), await part.agent("r")
    refused: list[str] = []

    def answer(query: agent_side.Query) -> None:
        query.reply(COMMAND, b"first")
        with pytest.raises(agent_side.TransportError):
            query.reply(COMMAND, b"second")
        refused.append("second")

    def answer_elsewhere(query: agent_side.Query) -> None:
        with pytest.raises(agent_side.TransportError):
            query.reply(COMMAND, b"elsewhere")
        refused.append("elsewhere")

    with agent.declare_queryable(COMMAND, answer), agent.declare_queryable(STOP, answer_elsewhere):
        await met(gateway, agent)
        assert await asked(gateway, question()) == [Answer(b"first", COMMAND)]
        assert await asked(gateway, question(STOP)) == []
    assert refused == ["second", "elsewhere"]


@contract
async def test_an_answer_may_come_from_a_thread(part: Network) -> None:
    gateway, agent = await part.gateway(), await part.agent("r")
    answering: list[asyncio.Task[None]] = []

    def answer(query: agent_side.Query) -> None:
        answering.append(asyncio.create_task(asyncio.to_thread(query.reply, COMMAND, b"late")))

    with agent.declare_queryable(COMMAND, answer):
        await met(gateway, agent)
        assert await asked(gateway, question()) == [Answer(b"late", COMMAND)]
        await asyncio.gather(*answering)


@contract
async def test_a_queryable_that_is_withdrawn_is_asked_no_more(part: Network) -> None:
    gateway, agent = await part.gateway(), await part.agent("r")
    with answers(agent, COMMAND, b"yes"):
        await met(gateway, agent, "before")
        assert await asked(gateway, question()) != []
    await met(gateway, agent, "after")
    assert await asked(gateway, question()) == []


@contract
@pytest.mark.parametrize("end", ["kill", "leave"])
async def test_a_query_ends_when_its_queryable_is_gone(part: Network, end: str) -> None:
    gateway, agent = await part.gateway(), await part.agent("r")
    held: list[agent_side.Query] = []
    part.keep(agent.declare_queryable(COMMAND, held.append))
    await met(gateway, agent)
    waiting = asyncio.create_task(asked(gateway, question()))
    await until(lambda: held)
    if end == "kill":
        part.kill("r")
    else:
        await part.leave("r")
    assert await waiting == []
    held.clear()


# -- tokens ---------------------------------------------------------------------------------------------------------


@contract
async def test_earlier_tokens_and_later_changes_are_reported(part: Network) -> None:
    gateway, agent = await part.gateway(), await part.agent("r")
    late = KEYS.presence("late", 2)
    with agent.declare_token(TOKEN):
        seen = Seen()
        await gateway.subscribe_tokens(KEYS.all_presence, seen.take)
        await until(lambda: seen.present == {TOKEN})
        with agent.declare_token(late):
            await until(lambda: seen.present == {TOKEN, late})
        await until(lambda: seen.present == {TOKEN})
    await until(lambda: not seen.present)
    assert seen == [(TOKEN, True), (late, True), (late, False), (TOKEN, False)]


@contract
async def test_agents_see_the_token_of_a_gateway_as_long_as_it_is_there(part: Network) -> None:
    first, agent = await part.gateway(), await part.agent("r")
    seen = Seen()
    with agent.subscribe_tokens(KEYS.all_gateways, seen.take):
        await first.declare_token(GATEWAY)
        await until(lambda: seen == [(GATEWAY, True)])
        await first.close()
        await until(lambda: seen == [(GATEWAY, True), (GATEWAY, False)])
        second = await part.gateway()
        await second.declare_token(GATEWAY)
        await until(lambda: seen == [(GATEWAY, True), (GATEWAY, False), (GATEWAY, True)])


@contract
async def test_renewed_declarations_are_announced_and_keep_working(part: Network) -> None:
    """Except its subscriptions to tokens, which would miss tokens that vanish meanwhile."""
    gateway, agent = await part.gateway(), await part.agent("r")
    seen, told, heard = Seen(), Seen(), await listening(gateway, agent)
    await gateway.subscribe_tokens(KEYS.all_presence, told.take)
    await gateway.declare_token(GATEWAY)
    with agent.subscribe_tokens(KEYS.all_gateways, seen.take), agent.declare_token(TOKEN):
        await until(lambda: seen and told)
        await gateway.redeclare()
        await until(lambda: seen == [(GATEWAY, True), (GATEWAY, False), (GATEWAY, True)])
        for key in (STATE, PROGRESS):
            with agent.declare_publisher(key, reliable=True, express=True) as publisher:
                publisher.put(b"1")
                await until(lambda key=key: heard.numbers(key) == [1])  # type: ignore[misc]
    await until(lambda: told == [(TOKEN, True), (TOKEN, False)])


@contract
async def test_all_tokens_are_listed_however_many(part: Network) -> None:
    gateway, agent = await part.gateway(), await part.agent("r")
    names = [KEYS.presence(f"r{number}", 1) for number in range(300)]  # more than a Zenoh channel holds
    for name in names:
        part.keep(agent.declare_token(name))
    await met(gateway, agent)
    listed, complete = await gateway.list_tokens(KEYS.all_presence, 5.0, list)
    assert (sorted(listed), complete) == (sorted(names), True)
    assert await gateway.list_tokens(KEYS.all_presence_of_robot("r7"), 5.0, list) == ([names[7]], True)
    assert await gateway.list_tokens(KEYS.all_presence_of_robot("nobody"), 5.0, list) == ([], True)


@contract
async def test_agents_list_the_tokens_of_each_other_and_their_own(part: Network) -> None:
    gateway, one, other = await part.gateway(), await part.agent("one"), await part.agent("other")
    with one.declare_token(TOKEN), other.declare_token(KEYS.presence("r", 2)):
        await met(gateway, one, "one")
        await met(gateway, other, "other")
        assert await one.list_tokens(KEYS.all_presence_of_robot("r"), 5.0) == {TOKEN, KEYS.presence("r", 2)}
        assert await other.list_tokens(KEYS.all_presence_of_robot("nobody"), 5.0) == set()


@contract
async def test_a_token_that_two_have_goes_with_the_last(part: Network) -> None:
    gateway, one, other = await part.gateway(), await part.agent("one"), await part.agent("other")
    seen = Seen()
    await gateway.subscribe_tokens(KEYS.all_presence, seen.take)
    with one.declare_token(TOKEN):
        await until(lambda: seen)
        with other.declare_token(TOKEN):
            await met(gateway, other, "other")
        with other.declare_token(KEYS.presence("after", 1)):
            await until(lambda: KEYS.presence("after", 1) in seen.present)
            assert TOKEN in seen.present
    await until(lambda: TOKEN not in seen.present)


@contract
async def test_a_visible_robot_can_be_queried(part: Network) -> None:
    """The token that was declared last becomes visible last."""
    gateway, agent = await part.gateway(), await part.agent("r")
    loop, news = asyncio.get_running_loop(), asyncio.Queue[str]()
    await gateway.subscribe_tokens(
        KEYS.all_presence, lambda key, present: loop.call_soon_threadsafe(news.put_nowait, key)
    )
    for number in range(50):
        name = f"r{number}"
        part.keep(answers(agent, KEYS.robot(name, "command"), b"here"))
        part.keep(agent.declare_token(KEYS.presence(name, 1)))
    for _ in range(50):
        key = KEYS.robot(KEYS.parse(await news.get()).robot, "command")
        assert await asked(gateway, question(key)) == [Answer(b"here", key)]


# -- faults ---------------------------------------------------------------------------------------------------------


@contract
@pytest.mark.parametrize("end", ["kill", "leave"])
async def test_all_of_a_session_that_ends_is_gone(part: Network, end: str) -> None:
    gateway, agent = await part.gateway(), await part.agent("r")
    seen = Seen()
    await gateway.subscribe_tokens(KEYS.all_presence, seen.take)
    part.keep(answers(agent, COMMAND, b"yes"))
    part.keep(agent.declare_token(TOKEN))
    await until(lambda: seen.present)
    if end == "kill":
        part.kill("r")
    else:
        await part.leave("r")
    await until(lambda: not seen.present)
    assert await asked(gateway, question()) == []
    assert await gateway.list_tokens(KEYS.all_presence, 5.0, list) == ([], True)


@contract
async def test_declarations_are_known_to_later_gateways(part: Network) -> None:
    first, agent = await part.gateway(), await part.agent("r")
    heard = await listening(first, agent)
    with answers(agent, COMMAND, b"yes"), agent.declare_token(TOKEN):
        await met(first, agent)
        await first.close()
        second, seen = await part.gateway(), Seen()
        await second.subscribe_tokens(KEYS.all_presence, seen.take)
        await until(lambda: TOKEN in seen.present)
        assert await asked(second, question()) == [Answer(b"yes", COMMAND)]
        before = len(heard)
        assert await listening(second, agent) != []
        assert len(heard) == before, "a session that is closed hears nothing"


@contract
async def test_a_cut_shorter_than_the_lease_loses_nothing(part: Network) -> None:
    gateway, agent = await part.gateway(), await part.agent("r")
    heard, seen = await listening(gateway, agent), Seen()
    await gateway.subscribe_tokens(KEYS.all_presence, seen.take)
    with answers(agent, COMMAND, b"yes"), agent.declare_publisher(PROGRESS, reliable=True, express=True) as ends:
        part.keep(agent.declare_token(TOKEN))
        await until(lambda: seen.present == {TOKEN})
        part.cut("r")
        for number in range(10):
            ends.put(str(number).encode())
        waiting = asyncio.create_task(asked(gateway, question()))
        part.heal("r")
        await until(lambda: 9 in heard.numbers(PROGRESS))
        assert heard.numbers(PROGRESS) == list(range(10))
        assert await waiting == [Answer(b"yes", COMMAND)]
    assert seen == [(TOKEN, True)]


@contract
async def test_a_long_cut_takes_each_side_from_the_other_and_healed_both_come_back(part: Network) -> None:
    gateway, agent = await part.gateway(), await part.agent("r")
    robots, gateways = Seen(), Seen()
    await gateway.subscribe_tokens(KEYS.all_presence, robots.take)
    await gateway.declare_token(GATEWAY)
    heard = await listening(gateway, agent)
    with (
        answers(agent, COMMAND, b"yes"),
        agent.declare_publisher(PROGRESS, reliable=True, express=True) as ends,
        agent.subscribe_tokens(KEYS.all_gateways, gateways.take),
        agent.declare_token(TOKEN),
    ):
        await until(lambda: robots.present == {TOKEN} and gateways.present == {GATEWAY})
        part.cut("r")
        assert [each.payload for each in await asked(gateway, question(timeout_s=0.1))] == [None]
        waiting = asyncio.create_task(asked(gateway, question()))
        await until(lambda: not robots.present)
        assert await waiting == []
        assert await asked(gateway, question()) == []
        await until(lambda: not gateways.present)
        ends.put(b"1")  # to nobody
        part.heal("r")
        await until(lambda: robots.present == {TOKEN} and gateways.present == {GATEWAY})
        assert await asked(gateway, question()) == [Answer(b"yes", COMMAND)]
        await listening(gateway, agent)
        ends.put(b"2")
        await until(lambda: heard.numbers(PROGRESS)[-1:] == [2])
        assert heard.numbers(PROGRESS) == [2]
    assert robots[:3] == [(TOKEN, True), (TOKEN, False), (TOKEN, True)]
    assert gateways[:3] == [(GATEWAY, True), (GATEWAY, False), (GATEWAY, True)]
