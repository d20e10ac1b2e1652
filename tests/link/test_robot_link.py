"""The agent's link: names, answers, gateways and publications."""

import asyncio
import logging
from collections.abc import Callable
from typing import Any

import pytest

from link.parts import LEASE_S, Memory, Network, contract
from link.test_contract import asked, question
from linked_fleet_agent.link import DuplicateNameError, RobotLink
from linked_fleet_agent.mesh_files import MeshError
from linked_fleet_agent.transport import Session
from linked_fleet_agent.wire.keys import Keys
from linked_fleet_agent.wire.transport import GATEWAY_LEASE_MS, HEARTBEAT_S
from linked_fleet_link.heartbeat import Heartbeat
from linked_fleet_link.transport import Answer
from serving import until
from virtual.zenoh_agent import AgentSession

KEYS = Keys("site/hall-2")
TICK_S = 0.01
in_memory = pytest.mark.parametrize("part", [Memory])


def link(session: Session, incarnation: int = 1, **more: Any) -> RobotLink:
    defaults: dict[str, Any] = {
        "description": b"I am r",
        "on_command": lambda payload: b"command " + payload,
        "on_stop": lambda payload: b"stop " + payload,
        "lease_ms": round(LEASE_S * 1000),
    }
    return RobotLink(session, KEYS, robot="r", incarnation=incarnation, **defaults | more)


async def watching(link: RobotLink, condition: Callable[[], bool]) -> None:
    """Tick like an agent until the condition is true."""
    while not condition():
        link.watch_gateways(TICK_S)
        await asyncio.sleep(TICK_S)


# -- names ----------------------------------------------------------------------------------------------------------


@contract
async def test_a_second_agent_of_the_same_name_is_refused_and_the_first_goes_on(part: Network) -> None:
    gateway, first = await part.gateway(), await part.agent("first")
    async with link(first, 1):
        with pytest.raises(DuplicateNameError, match="run 1"):
            async with link(await part.agent("second"), 2):
                pass
        command = KEYS.robot("r", "command")
        assert await asked(gateway, question(command, payload=b"go")) == [Answer(b"command go", command)]
        assert await gateway.list_tokens(KEYS.all_presence, 5.0, list) == ([KEYS.presence("r", 1)], True)
    await part.leave("first")


@contract
async def test_the_token_of_a_killed_agent_is_waited_for(part: Network) -> None:
    gateway, first = await part.gateway(), await part.agent("first")
    await link(first, 1).__aenter__()
    second = await part.agent("second")
    await until_listed(gateway, 1)
    part.cut("first")
    async with link(second, 2):
        await until_listed(gateway, 2)


async def until_listed(gateway: Any, run: int) -> None:
    """Wait until this run of the robot is the only one that the gateway sees."""
    while await gateway.list_tokens(KEYS.all_presence, 5.0, list) != ([KEYS.presence("r", run)], True):  # noqa: ASYNC110
        await asyncio.sleep(0.01)


@in_memory
@contract
async def test_of_two_simultaneous_agents_the_older_run_stays(part: Network) -> None:
    await part.gateway()
    links = [link(await part.agent(f"run {run}"), run) for run in (1, 2)]
    await asyncio.sleep(0.1)
    entered = await asyncio.gather(*(each.__aenter__() for each in links), return_exceptions=True)
    assert entered[0] is links[0]
    assert isinstance(entered[1], DuplicateNameError)


# -- answers --------------------------------------------------------------------------------------------------------


@contract
async def test_each_query_is_answered_by_its_handler(part: Network) -> None:
    gateway, session = await part.gateway(), await part.agent("r")

    def mesh(payload: bytes) -> bytes:
        raise MeshError(f"no mesh {payload.decode()}")

    async with link(session, on_mesh=mesh, on_picture=lambda payload: b"picture " + payload):
        await until_listed(gateway, 1)
        replies = {
            kind: [answer.payload for answer in await asked(gateway, question(KEYS.robot("r", kind), payload=b"x"))]
            for kind in ("description", "command", "stop", "mesh", "picture")
        }
        assert replies == {
            "description": [b"I am r"],
            "command": [b"command x"],
            "stop": [b"stop x"],
            "mesh": [None],
            "picture": [b"picture x"],
        }
        assert await asked(gateway, question(KEYS.all_stops, payload=b"all")) == [
            Answer(b"stop all", KEYS.robot("r", "stop"))
        ]
    assert await asked(gateway, question(KEYS.robot("r", "description"))) == []


@in_memory
@contract
async def test_a_visible_robot_answers_queries(part: Memory) -> None:
    gateway, session = await part.gateway(), await part.agent("r")
    part.network.set_faults(latency_s=(0.0, 0.05))
    asking: list[asyncio.Task[list[Answer]]] = []

    def ask(key: str, present: bool) -> None:
        for kind in ("description", "command", "stop", "mesh", "picture"):
            asking.append(asyncio.create_task(asked(gateway, question(KEYS.robot("r", kind)))))

    await gateway.subscribe_tokens(KEYS.all_presence, ask)
    async with link(session, on_mesh=lambda payload: b"", on_picture=lambda payload: b""):
        await until(lambda: asking)
        assert [len(answers) for answers in await asyncio.gather(*asking)] == [1] * 5


@in_memory
@contract
async def test_more_slow_questions_than_may_wait_are_refused_at_once(part: Network) -> None:
    gateway, session = await part.gateway(), await part.agent("r")
    async with link(session, on_picture=lambda payload: b"picture"):
        await until_listed(gateway, 1)
        many = [asked(gateway, question(KEYS.robot("r", "picture"))) for _ in range(20)]
        found = [answer.payload for [answer] in await asyncio.gather(*many)]
    assert (found.count(b"picture"), found.count(None)) == (8, 12)


@in_memory
@contract
async def test_a_picture_that_fails_unexpectedly_is_refused(part: Network, caplog: pytest.LogCaptureFixture) -> None:
    """A driver may raise whatever its hardware library does. The next picture is taken all the same."""
    gateway, session = await part.gateway(), await part.agent("r")
    failures = [OSError("no such device")]

    def picture(_: bytes) -> bytes:
        if failures:
            raise failures.pop()
        return b"picture"

    async with link(session, on_picture=picture):
        await until_listed(gateway, 1)
        begin_s = asyncio.get_running_loop().time()
        found = [await asked(gateway, question(KEYS.robot("r", "picture"))) for _ in range(2)]
        assert asyncio.get_running_loop().time() - begin_s < 1.0
    assert [[answer.payload for answer in answers] for answers in found] == [[None], [b"picture"]]
    assert "no such device" in caplog.text


# -- gateways -------------------------------------------------------------------------------------------------------


@contract
async def test_a_gateway_is_present_while_its_token_is_there_and_it_sends_heartbeats(part: Network) -> None:
    gateway, session = await part.gateway(), await part.agent("r")
    async with link(session) as robot:
        assert not robot.gateway_present
        beats = Heartbeat(gateway, KEYS.heartbeat("g"))
        beats.start()
        await gateway.declare_token(KEYS.gateway("g"))
        await watching(robot, lambda: robot.gateway_present)
        assert robot.arrivals == 1
        beats.close()  # the token stays
        await watching(robot, lambda: not robot.gateway_present)
        beats.start()
        await watching(robot, lambda: robot.gateway_present)
        assert robot.arrivals == 2
        beats.close()
        await gateway.close()
        await watching(robot, lambda: not robot.gateway_present)


@in_memory
@contract
async def test_a_gateway_that_is_cut_off_is_gone_within_its_lease(part: Network) -> None:
    gateway, session = await part.gateway(), await part.agent("r")
    loop = asyncio.get_running_loop()
    async with link(session) as robot:
        beats = Heartbeat(gateway, KEYS.heartbeat("g"))
        beats.start()
        await gateway.declare_token(KEYS.gateway("g"))
        await watching(robot, lambda: robot.gateway_present)
        part.cut("r")
        began_s, lease_s = loop.time(), GATEWAY_LEASE_MS / 1000
        await watching(robot, lambda: not robot.gateway_present)
        assert lease_s - HEARTBEAT_S <= loop.time() - began_s <= lease_s + 2 * TICK_S
        part.heal("r")
        await watching(robot, lambda: robot.gateway_present)
        beats.close()


@in_memory
@contract
async def test_heartbeats_are_subscribed_to_while_the_token_is_there(part: Network) -> None:
    """After a token has vanished, but not before all other agents noticed: routers only report the first subscriber."""
    gateway, session = await part.gateway(), await part.agent("r")
    assert isinstance(session, AgentSession)

    def subscribed() -> bool:
        return bool(session.matching("subscriber", KEYS.heartbeat("g")))

    async with link(session):
        await gateway.declare_token(KEYS.gateway("g"))
        await until(subscribed)
        await gateway.redeclare()
        await until(lambda: not subscribed())
        await asyncio.sleep(0.4)
        assert not subscribed()
        await until(subscribed)
        await gateway.close()
        await until(lambda: not subscribed())
        another = await part.gateway()
        await another.declare_token(KEYS.gateway("g"))
        await asyncio.sleep(0.1)
    await asyncio.sleep(1)
    assert not subscribed()


# -- publications ---------------------------------------------------------------------------------------------------


@contract
async def test_undeliverable_publications_are_dropped_and_logged_once(
    part: Network, caplog: pytest.LogCaptureFixture
) -> None:
    await part.gateway()
    robot = await link(await part.agent("r")).__aenter__()
    await part.leave("r")
    with caplog.at_level(logging.WARNING, "linked_fleet_agent.link"):
        for _ in range(3):
            robot.publish_state(b"")
            robot.publish_progress(b"", final=True)
    assert [record.message.partition(":")[2].partition(":")[0] for record in caplog.records] == [
        " publications are dropped"
    ]


@contract
async def test_an_agent_publishes_under_its_own_keys(part: Network) -> None:
    gateway, session = await part.gateway(), await part.agent("r")
    heard = set[tuple[str, object]]()
    for key in (KEYS.all_states, KEYS.all_progress, KEYS.all_conditions):
        await gateway.subscribe(key, 100, lambda key, payload: heard.add((key, payload)))
    async with link(session) as robot:
        while len(heard) < 4:
            robot.publish_state(b"state")
            robot.publish_condition(b"condition")
            robot.publish_progress(b"running", final=False)
            robot.publish_progress(b"succeeded", final=True)
            await asyncio.sleep(0.01)
    progress = KEYS.robot("r", "progress")
    assert heard == {
        (KEYS.robot("r", "state"), b"state"), (KEYS.robot("r", "condition"), b"condition"), (progress, b"running"),
        (progress, b"succeeded"),
    }  # fmt: skip
