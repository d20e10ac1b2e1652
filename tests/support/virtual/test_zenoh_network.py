"""Faults of the in-memory Zenoh network, and the reproducibility of runs with one seed.

What it has in common with Zenoh is tested in ``tests/link/test_contract.py``.
"""

import asyncio
from collections.abc import Callable

import pytest

from linked_fleet_agent.wire.keys import Keys
from linked_fleet_link.transport import Answer, Question
from virtual.confined import confined
from virtual.loop import VirtualLoop, on_virtual_time
from virtual.zenoh_agent import AgentSession
from virtual.zenoh_gateway import GatewaySession
from virtual.zenoh_network import ZenohNetwork
from virtual.zenoh_sessions import intersects

KEYS = Keys()
STATE, PROGRESS, COMMAND = (KEYS.robot("r", kind) for kind in ("state", "progress", "command"))
TOKEN = KEYS.presence("r", 1)


class Scene:
    """A connected gateway and agent; what the gateway heard, with the time of the loop."""

    def __init__(self, network: ZenohNetwork) -> None:
        self.network, self.loop = network, asyncio.get_running_loop()
        self.heard: list[tuple[float, str, object]] = []

    async def __aenter__(self) -> "Scene":
        opened = await self.network.gateway("g")((), (), {})
        assert isinstance(opened, GatewaySession)
        self.gateway, self.agent = opened, self.network.agent("r")
        for subscribe in (self.gateway.subscribe_frames, self.gateway.subscribe):
            await subscribe(STATE if subscribe == self.gateway.subscribe_frames else PROGRESS, 10**6, self.note)
        await self.gateway.subscribe_tokens(KEYS.all_presence, self.note)
        self.agent.declare_token(TOKEN)
        await asyncio.sleep(1)
        return self

    async def __aexit__(self, *_: object) -> None:
        await self.gateway.close()
        await self.agent.close()

    def note(self, key: str, news: object) -> None:
        self.heard.append((self.loop.time(), key, news))

    def of(self, key: str) -> list[object]:
        return [news for _, heard, news in self.heard if heard == key]

    def since(self, began_s: float, key: str) -> list[float]:
        return [at_s - began_s for at_s, heard, _ in self.heard if heard == key and at_s > began_s]


def run(test: Callable[[Scene], object], **faults: object) -> Scene:
    """Run a scenario and return it, with what was heard."""
    scenes = []

    async def main() -> None:
        async with Scene(ZenohNetwork(**faults)) as scene:  # type: ignore[arg-type]
            scenes.append(scene)
            await test(scene)  # type: ignore[misc]

    on_virtual_time(main)
    return scenes[0]


async def talk(scene: Scene, count: int = 200) -> None:
    """Publish numbers on both keys, 10 ms apart."""
    with (
        scene.agent.declare_publisher(STATE, reliable=False, express=False) as states,
        scene.agent.declare_publisher(PROGRESS, reliable=True, express=True) as ends,
    ):
        for number in range(count):
            states.put(b"%d" % number)
            ends.put(b"%d" % number)
            await asyncio.sleep(0.01)
        await asyncio.sleep(1)


NUMBERS = [b"%d" % number for number in range(200)]


@pytest.mark.parametrize(
    ("one", "other", "same"),
    [
        ("a/b", "a/b", True),
        ("a/b", "a/c", False),
        ("a/b", "a/b/c", False),
        ("a/*/c", "a/b/c", True),
        ("a/*", "a/b/c", False),
        ("a/*/c", "a/b/*", True),
        ("a/**", "a", True),
        ("a/**", "a/b/c", True),
        ("a/**/d", "a/b/c/d", True),
        ("a/**/d", "a/b/c", False),
        ("**", "**/x", True),
        ("a/b/*", "**/c", True),
    ],
)
def test_keys_that_match(one: str, other: str, same: bool) -> None:
    assert intersects(one, other) == intersects(other, one) == same


def test_only_droppable_messages_are_lost() -> None:
    scene = run(talk, seed=3, loss=0.25)
    states = scene.of(STATE)
    assert 100 < len(states) < 180
    assert states == [number for number in NUMBERS if number in states]
    assert scene.of(PROGRESS) == NUMBERS


def test_order_holds_however_the_latency_varies() -> None:
    scene = run(talk, seed=4, latency_s=(0.0, 0.5))
    assert scene.of(STATE) == scene.of(PROGRESS) == NUMBERS


def test_one_seed_gives_one_run_and_another_seed_another() -> None:
    async def broken(scene: Scene) -> None:
        talking = asyncio.create_task(talk(scene))
        await asyncio.sleep(0.3)
        scene.network.partition("g", "r")
        await asyncio.sleep(3.0)
        scene.network.heal("g", "r")
        await talking
        await asyncio.sleep(2)

    def heard(seed: int) -> list[tuple[float, str, object]]:
        return run(broken, seed=seed, latency_s=(0.001, 0.02), loss=0.1).heard

    assert heard(1) == heard(1)
    assert heard(1) != heard(2)


@pytest.mark.parametrize(("silently", "at_least_s", "at_most_s"), [(False, 0.001, 0.001), (True, 1.5, 2.0)])
def test_a_killed_agent_is_gone_at_once_or_after_its_lease(silently: bool, at_least_s: float, at_most_s: float) -> None:
    async def kill(scene: Scene) -> None:
        began_s = scene.loop.time()
        scene.network.kill("r", silently)
        scene.network.heal("g", "r")  # nothing to heal
        await asyncio.sleep(5)
        [gone_s] = scene.since(began_s, TOKEN)
        assert at_least_s - 1e-6 <= gone_s <= at_most_s + 1e-6
        again = scene.network.agent("r")
        with again.declare_token(KEYS.presence("r", 2)):
            await asyncio.sleep(1)
        assert scene.of(KEYS.presence("r", 2)) == [True]

    assert run(kill).of(TOKEN) == [True, False]


def test_a_killed_session_calls_nothing_back_and_refuses() -> None:
    async def kill(scene: Scene) -> None:
        told: list[bytes] = []
        scene.agent.declare_queryable(COMMAND, lambda query: told.append(query.payload))
        await asyncio.sleep(0.1)
        asking = asyncio.create_task(scene.gateway.ask(Question(COMMAND, b"", 1.0, 10), lambda answer: None))
        scene.network.kill("r")
        await asking
        await asyncio.sleep(2)
        assert told == []
        with pytest.raises(AgentSession.error):
            scene.agent.declare_token(TOKEN)

    run(kill)


def test_an_impatient_question_is_given_up_where_too_much_waits_already() -> None:
    async def flood(scene: Scene) -> None:
        answers: dict[bytes, list[Answer | None]] = {b"first": [], b"last": []}
        scene.agent.declare_queryable(COMMAND, lambda query: query.reply(COMMAND, query.payload))
        await asyncio.sleep(0.1)
        scene.network.partition("g", "r")

        async def ask(payload: bytes, blocking: bool = False) -> None:
            hear = answers.setdefault(payload, []).append
            await scene.gateway.ask(Question(COMMAND, payload, 1.0, 10**7, blocking=blocking), hear)

        await ask(b"first")
        await ask(bytes(10**6), blocking=True)
        await ask(b"last")
        scene.network.heal("g", "r")
        await asyncio.sleep(2)
        assert answers[b"first"] == [Answer(b"first", COMMAND), None]
        assert answers[bytes(10**6)] == [Answer(bytes(10**6), COMMAND), None]
        assert answers[b"last"] == [Answer(None, COMMAND), None]

    run(flood)


def test_two_gateways_are_cut_off_each_for_itself() -> None:
    async def cut(scene: Scene) -> None:
        other = await scene.network.gateway("h")((), (), {})
        seen: list[tuple[str, bool]] = []
        await other.subscribe_tokens(KEYS.all_presence, lambda key, present: seen.append((key, present)))
        await asyncio.sleep(2)
        scene.network.partition("h", "r")
        await asyncio.sleep(3)
        assert seen == [(TOKEN, True), (TOKEN, False)]
        assert scene.of(TOKEN) == [True]
        scene.network.heal("r", "h")
        await asyncio.sleep(2)
        assert seen[2:] == [(TOKEN, True)]

    run(cut)


def test_a_process_that_goes_on_heals_no_partition_and_hears_of_tokens_as_itself() -> None:
    async def stop(scene: Scene) -> None:
        loop = scene.loop
        assert isinstance(loop, VirtualLoop)
        process, news = loop.confine("agent"), list[tuple[bool, object]]()
        agent = process.run(scene.network.agent, "s", 60.0)
        agent.subscribe_tokens(KEYS.all_gateways, lambda _, present: news.append((present, confined())))
        await scene.gateway.declare_token(KEYS.gateway("g"))
        await asyncio.sleep(1)
        scene.network.partition("g", "s")
        process.stop()
        process.go_on()
        with agent.declare_token(KEYS.presence("s", 1)):
            await asyncio.sleep(1)
            assert scene.of(KEYS.presence("s", 1)) == []
            scene.network.heal("g", "s")
            await asyncio.sleep(1)
            assert scene.of(KEYS.presence("s", 1)) == [True]
        scene.network.kill("g")
        await asyncio.sleep(1)
        assert news == [(True, process), (False, process)]

    run(stop)


def test_a_process_that_is_stopped_does_not_miss_its_peer_and_has_what_was_sent_once_it_goes_on() -> None:
    async def stop(scene: Scene) -> None:
        loop = scene.loop
        assert isinstance(loop, VirtualLoop)
        process, asked = loop.confine("agent"), list[bytes]()
        agent = process.run(scene.network.agent, "s", 60.0)
        key = KEYS.robot("s", "command")
        agent.declare_queryable(key, lambda query: asked.append(query.payload))
        await asyncio.sleep(1)
        process.stop()
        await scene.gateway.ask(Question(key, b"late", 1.0, 10**6), lambda answer: None)
        await asyncio.sleep(30)  # longer than the lease of the gateway
        assert asked == []
        process.go_on()
        await asyncio.sleep(1)
        assert asked == [b"late"]

    run(stop)


def test_a_gateway_that_connects_to_a_router_lists_at_once_who_is_there() -> None:
    async def join(scene: Scene) -> None:
        later = await scene.network.gateway("h")((), ("tcp/router",), {})
        while not later.connected:  # noqa: ASYNC110 - like Zenoh, it does not notify
            await asyncio.sleep(0.01)
        assert await later.list_tokens(KEYS.all_presence, 1.0, list) == ([TOKEN], True)
        await later.close()

    run(join, latency_s=(0.05, 0.05))


def test_processes_that_are_stopped_together_are_connected_once_both_go_on() -> None:
    async def stop(scene: Scene) -> None:
        loop = scene.loop
        assert isinstance(loop, VirtualLoop)
        one, other = loop.confine("gateway"), loop.confine("agent")
        gateway = await loop.create_task(scene.network.gateway("h")((), (), {}), context=one._context.copy())
        agent = other.run(scene.network.agent, "s")
        asked, key = list[bytes](), KEYS.robot("s", "command")
        agent.declare_queryable(key, lambda query: asked.append(query.payload))
        await asyncio.sleep(2)
        one.stop()
        other.stop()
        await asyncio.sleep(30)  # longer than the leases of both
        one.go_on()
        other.go_on()
        await asyncio.sleep(2)
        await gateway.ask(Question(key, b"again", 1.0, 10**6), lambda answer: None)
        await asyncio.sleep(1)
        assert asked == [b"again"]
        await gateway.close()

    run(stop)
