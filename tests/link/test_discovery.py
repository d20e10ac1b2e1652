"""Floods of liveliness tokens in Zenoh sessions: their cost for a gateway and its robots."""

import asyncio
import contextlib
from collections.abc import AsyncIterator, Callable, Iterator

import pytest
import zenoh

from fake_robots import KEYS, FakeRobot, open_session
from linked_fleet_agent.wire.codec import encode
from linked_fleet_agent.wire.messages import WIRE_VERSION, Accepted, Command, Description, Move
from linked_fleet_link import discovery
from linked_fleet_link.discovery import Discovery, Judge
from linked_fleet_link.fleet_link import FleetLink
from linked_fleet_state.events import Appeared, Described, Event, Vanished
from linked_fleet_state.fleet import MAX_UNDESCRIBED, Fleet
from linked_fleet_state.presence import FIRST_OPEN, MAX_RUNS, Token
from running import free_port
from serving import until
from virtual.processes import gateway_session

pytestmark = pytest.mark.virtual
NAMES = 500
RUNS = 1000


class Gateway:
    """A fleet on a link."""

    def __init__(self, endpoint: str) -> None:
        self.fleet = Fleet()
        self.events: list[Event] = []
        self._changed = asyncio.Event()
        self.link = FleetLink(KEYS, "g", lambda: gateway_session(endpoint), self._on_events, lambda *_: None)

    def _on_events(self, events: list[Event]) -> None:
        for event in events:
            self.fleet.apply(event, 1)
        self.events += events
        self._changed.set()

    async def until(self, condition: Callable[[], bool]) -> None:
        while not condition():
            self._changed.clear()
            await self._changed.wait()

    async def sees(self, robot: str) -> None:
        await self.until(lambda: robot in self.fleet.robots and self.fleet.robots[robot].described)


@contextlib.asynccontextmanager
async def opened() -> AsyncIterator[tuple[Gateway, str]]:
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    gateway = Gateway(endpoint)
    async with gateway.link:
        await gateway.link.join()
        yield gateway, endpoint


@contextlib.contextmanager
def flooding(endpoint: str, tokens: list[str]) -> Iterator[zenoh.Session]:
    with open_session(endpoint) as session:
        kept = [session.liveliness().declare_token(token) for token in tokens]
        yield session
        for token in kept:
            token.undeclare()


def command() -> Command:
    return Command(
        version=WIRE_VERSION, id="c1", incarnation=1, seen_ns=0, time_to_live_ns=10**9, motion=Move({"elbow": 0.5})
    )


async def test_a_flood_of_names_hides_no_robot_and_leaves_nothing_behind() -> None:
    async with opened() as (gateway, endpoint):
        with flooding(endpoint, [KEYS.presence(f"flood{number}", 1) for number in range(NAMES)]) as flood:
            held: list[zenoh.Query] = []
            hanging = flood.declare_queryable(KEYS.robot("flood1", "description"), held.append)
            with open_session(endpoint) as session:
                genuine = FakeRobot(session, "r").appear()  # its declarations last as long as the object
                answering = session.declare_queryable(
                    KEYS.robot("r", "command"),
                    lambda query: query.reply(KEYS.robot("r", "command"), encode(Accepted("c1"))),
                )
                await gateway.sees("r")
                assert await gateway.link.command("r", command(), 5) == Accepted("c1")
                await gateway.until(lambda: gateway.link.undescribed_count == NAMES)
                assert len(gateway.fleet.robots) <= MAX_UNDESCRIBED + 1
                answering.undeclare()
                assert genuine.name in gateway.fleet.robots
            held.clear()
            hanging.undeclare()
        await gateway.until(lambda: gateway.link.undescribed_count == 0)
        assert list(gateway.fleet.robots) == ["r"]


async def test_a_flood_of_runs_costs_its_own_name_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(discovery, "_RELIST_S", 0.1)
    async with opened() as (gateway, endpoint):
        with open_session(endpoint) as session:
            own = FakeRobot(session, "own").appear()
            other = FakeRobot(session, "other").appear()
            await gateway.sees("own")
            await gateway.sees("other")
            last = own.incarnation + RUNS
            tokens = [KEYS.presence("own", run) for run in range(own.incarnation + 1, last + 1)]
            with flooding(endpoint, tokens):
                await gateway.until(lambda: Appeared("own", last) in gateway.events)
                came = {event.incarnation for event in gateway.events if isinstance(event, Appeared)}
                gone = {event.incarnation for event in gateway.events if isinstance(event, Vanished)}
                assert len(came - gone - {other.incarnation}) <= MAX_RUNS
                assert gateway.fleet.robots["other"].online
            # The flood is undeclared: the run from before is found again.
            await gateway.until(lambda: gateway.fleet.robots["own"].incarnation == own.incarnation)
            await gateway.sees("own")
            assert Vanished("other", other.incarnation) not in gateway.events


async def test_one_question_asks_for_all_runs_of_a_robot() -> None:
    async with opened() as (gateway, endpoint):
        with open_session(endpoint) as session:
            asked = list[zenoh.Query]()

            def answer(query: zenoh.Query) -> None:
                asked.append(query)
                query.reply(KEYS.robot("r", "description"), FakeRobot(session, "r").description())

            described = session.declare_queryable(KEYS.robot("r", "description"), answer)
            tokens = [session.liveliness().declare_token(KEYS.presence("r", 10**6 + run)) for run in range(RUNS)]
            await gateway.until(lambda: gateway.link.malformed_counts != {} or len(gateway.fleet.malformed_counts) > 0)
            await until(lambda: len(asked) >= 3)
            assert len(asked) < RUNS / 10
            described.undeclare()
            del tokens


async def test_a_silent_robot_makes_room_for_one_that_comes(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("linked_fleet_state.presence.MAX_UNDESCRIBED", 20)
    monkeypatch.setattr(discovery, "_RELIST_S", 0.1)
    async with opened() as (gateway, endpoint):
        silent = [KEYS.presence(f"silent{number}", 1) for number in range(20)]
        with flooding(endpoint, silent):
            await gateway.until(
                lambda: gateway.link.undescribed_count == 20 and gateway.fleet.malformed_counts.total() >= 20
            )
            with open_session(endpoint) as session:
                late = FakeRobot(session, "late").appear()
                await gateway.sees(late.name)
                assert sum(isinstance(event, Vanished) for event in gateway.events) == 1
        await gateway.until(lambda: gateway.link.undescribed_count == 0)


async def test_a_reply_that_comes_after_all_runs_have_gone_blocks_nothing() -> None:
    """One of two runs has answered, both tokens go, and the reply of the other comes before the query ends."""
    queries, over, answered = list[Judge](), asyncio.Event(), asyncio.Event()

    async def query(_: str, judge: Judge) -> None:
        queries.append(judge)
        if len(queries) == 1:
            await over.wait()
            answered.set()
            judge(encode(_described(6)), "")
        else:
            judge(encode(_described(7)), "")

    async def tokens() -> tuple[list[Token], bool]:
        return [], True

    async def declare() -> None: ...

    events = list[Event]()
    found = Discovery(query, tokens, events.extend, lambda: None, declare)
    for run in (5, 6):
        found.apply_token(("r", run), True)
    await until(lambda: queries)
    assert queries[0](encode(_described(5)), "") is None
    for run in (5, 6):
        found.apply_token(("r", run), False)
    await until(lambda: len(events) == 2)
    over.set()
    await answered.wait()
    found.apply_token(("r", 7), True)
    await until(lambda: Described(_described(7)) in events)
    await found.close()


async def test_a_query_that_fails_unexpectedly_is_repeated_and_takes_no_place() -> None:
    """Without that, a robot stays undescribed, and after sixteen of them nobody is asked any more."""
    failures = 0

    async def query(_: str, judge: Judge) -> None:
        nonlocal failures
        if failures < 2 * FIRST_OPEN:
            failures += 1
            raise RuntimeError("unforeseen")
        judge(encode(_described(5)), "")

    async def tokens() -> tuple[list[Token], bool]:
        return [], True

    async def declare() -> None: ...

    events = list[Event]()
    found = Discovery(query, tokens, events.extend, lambda: None, declare)
    for number in range(FIRST_OPEN):
        found.apply_token((f"s{number}", 1), True)
    found.apply_token(("r", 5), True)
    await until(lambda: Described(_described(5)) in events)
    await found.close()


def _described(run: int) -> Description:
    return Description(
        version=WIRE_VERSION, robot="r", incarnation=run, title="R", urdf="", joints=(), rate_hz=50, layout=()
    )
