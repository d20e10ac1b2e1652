"""A small run of every target, so that none breaks unnoticed; and valid messages as their seeds."""

import asyncio
import time
from asyncio.events import Handle
from random import Random

import pytest

from fuzzing import bodies, good, mutation
from fuzzing.__main__ import SHARES, report, run
from fuzzing.body import AgentUnderTest, BrokenPromiseError
from fuzzing.findings import EPISODE, Tally, in_process, random_of
from fuzzing.living import in_batches
from fuzzing.stops import LATE_S, Stops
from fuzzing.watched import MOST_S, timed_callbacks
from linked_fleet_agent.wire.codec import decode, decode_reply
from linked_fleet_agent.wire.messages import Accepted, Command, Description, Progress, Stop
from linked_fleet_gateway.http.body import parse_body
from linked_fleet_state.answers import read_description

SEED = 7
COUNTS = {
    "wire": 1500,
    "bodies": 800,
    "http": 500,
    "sockets": 250,
    "robots": 250,
    "ros2": 1500,
    "foxglove": 250,
    "identities": 300,
    "mcp": 250,
    "descriptions": 500,
    "components": 2000,
}
PURE = {"wire", "components", "bodies", "ros2", "descriptions"}
SERVED = (pytest.mark.processes, pytest.mark.test_all)


@pytest.mark.parametrize("target", [name if name in PURE else pytest.param(name, marks=SERVED) for name in SHARES])
def test_a_slice_of_it_finds_nothing(target: str) -> None:
    tally = run(target, COUNTS[target], SEED)
    assert tally.inputs == COUNTS[target]
    assert not tally.findings, tally.findings


def test_good_messages_are_good() -> None:
    random = Random(1)
    for _ in range(20):
        patient = AgentUnderTest()
        made = good.command(random, patient.new_id(), patient.agent.incarnation, patient.now_ns)
        reply = decode_reply(patient.agent.handle(mutation.dumped(made)))
        assert isinstance(reply, Accepted), reply
        patient.pass_ms(10)
    assert decode(mutation.dumped(good.command(random, "a", 1, 1)), Command)
    assert decode(mutation.dumped(good.stop(random, "a")), Stop)
    assert decode(mutation.dumped(good.progress(random, "a", 1)), Progress)
    said = good.description(random, "arm", 1)
    assert read_description(mutation.dumped(good.tree_of(said)), "arm", (1,)) == (said, "")
    assert isinstance(said, Description)


@pytest.mark.parametrize("segment", good.BODIES)
def test_good_bodies_are_admitted(segment: str) -> None:
    path = bodies.path_of(segment)
    content = (good.TURTLE_PREFIXES + good.BODIES[segment]).encode()
    triples = parse_body(content, "text/turtle", bodies.BASE + path, bodies.BASE)
    bodies.Gate().judge(Random(1), segment, path, triples)


def test_an_input_depends_on_its_number_alone() -> None:
    assert bodies.body(random_of(SEED, 41), "rotate") == bodies.body(random_of(SEED, 41), "rotate")
    assert len({bodies.body(random_of(SEED, number), "rotate") for number in range(9)}) > 1


def test_an_exception_is_a_finding_with_a_reproducing_command(capsys: pytest.CaptureFixture[str]) -> None:
    def take(random: Random) -> None:
        if random.random() < 0.01:
            raise ZeroDivisionError("as an example")

    tally = in_process("wire", 2 * EPISODE, SEED, 0, lambda: take)
    (finding,) = tally.findings.values()
    assert finding.what.startswith("ZeroDivisionError")
    assert f"--only wire --seed {SEED} --first" in finding.command
    assert report([tally]) == 1
    assert finding.command in capsys.readouterr().out
    assert report([Tally("wire", SEED)]) == 0


def test_a_robot_that_is_sent_beyond_its_limits_is_a_broken_promise() -> None:
    patient = AgentUnderTest()
    patient.robot.apply({"pan": 1.5})
    with pytest.raises(BrokenPromiseError):
        patient.pass_ms(10)


def test_a_callback_that_keeps_the_loop_is_seen() -> None:
    """By the processor time of its thread: a sleeping callback is not."""
    seen: list[tuple[float, Handle]] = []

    async def busy() -> None:
        await asyncio.sleep(0)
        until_s = time.thread_time() + 2 * MOST_S
        while time.thread_time() < until_s:
            pass
        await asyncio.sleep(0)
        time.sleep(MOST_S)  # noqa: ASYNC251 - the loop is delayed without using the processor

    with timed_callbacks(lambda used_s, callback: seen.append((used_s, callback))):
        asyncio.run(busy())
    assert len([used_s for used_s, _ in seen if used_s > MOST_S]) == 1


@pytest.mark.parametrize(("stalls", "found"), [(99, 1), (2, 0), (0, 0)])
def test_a_stall_that_comes_back_each_time_is_a_finding(stalls: int, found: int) -> None:
    """A stall that does not repeat is the machine's."""

    class There:
        def __init__(self) -> None:
            self.stalls: list[str] = []

        def look(self, tally: Tally, first: int, count: int) -> bool:
            self.stalls += ["a callback took long"] * (len(sent) <= stalls)
            return True

        def warm(self) -> None:
            pass

        def judge(self, tally: Tally) -> None:
            pass

    sent: list[range] = []
    tally = in_batches("http", 100, SEED, 0, There(), lambda tally, batch: sent.append(batch))  # type: ignore[arg-type]
    assert len(tally.findings) == found
    assert set(sent) == {range(100)}


def test_a_stop_that_comes_late_is_told_once() -> None:
    stops = Stops("http://localhost/")
    stops._took_s += [0.01, LATE_S + 1, 0.01]
    assert (stops.late_s(), stops.late_s()) == (LATE_S + 1, 0.0)
    assert stops.note() == "stops 10 ms, at most 3000"
