"""A slice of every target, so that none rots; and that each begins from messages that are good."""

from random import Random

import pytest

from agents.wire.codec import decode, decode_reply
from agents.wire.messages import Accepted, Command, Description, Progress, Stop
from fuzz import bodies, good, mutation
from fuzz.__main__ import SHARES, report, run
from fuzz.body import BrokenPromiseError, Patient
from fuzz.findings import EPISODE, Tally, in_process, random_of
from gateway.fleet.answers import read_description
from gateway.http.body import parse_body

SEED = 7
COUNTS = {"wire": 1500, "bodies": 800, "http": 500, "sockets": 250, "robots": 250, "ros2": 1500, "identities": 300}


@pytest.mark.parametrize("target", SHARES)
def test_a_slice_of_it_finds_nothing(target: str) -> None:
    tally = run(target, COUNTS[target], SEED)
    assert tally.inputs == COUNTS[target]
    assert not tally.findings, tally.findings


def test_good_messages_are_good() -> None:
    random = Random(1)
    for _ in range(20):
        patient = Patient()
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


def test_what_a_target_raises_is_a_finding_with_the_command_that_repeats_it(capsys: pytest.CaptureFixture[str]) -> None:
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
    patient = Patient()
    patient.robot.apply({"pan": 1.5})
    with pytest.raises(BrokenPromiseError):
        patient.pass_ms(10)
