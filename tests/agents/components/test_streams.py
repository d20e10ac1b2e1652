"""Streams of inputs: which samples an agent applies, what silence does, and what ends a stream."""

import asyncio
import math
import random
from typing import Any

import msgspec
import pytest
from msgspec import UNSET, Raw

from component_agent import Bench
from driven_base import LIMITS, Driven
from linked_fleet_agent.components import Call, Component, DeclarationError, InputStream, StreamLimits, action
from linked_fleet_agent.components.declaration import declare
from linked_fleet_agent.components.host import declarations_of
from linked_fleet_agent.planar import STANDING
from linked_fleet_agent.wire import codec
from linked_fleet_agent.wire.components import Sample
from linked_fleet_agent.wire.messages import Accepted, Refused, StreamCounts

MS = 1_000_000
TICK_S = 0.01


class Streamed(Driven):
    """A base that is driven by a stream. ``seen_ns`` of a sample is the present time unless it is given."""

    def open(self, id: str = "s") -> None:
        reply = self.operate(id, "drive", {}, component="mobile_base", stream=True)
        assert isinstance(reply, Accepted), reply

    def sample(self, number: int, linear: Any = 0.5, *, id: str = "s", age_ms: float = 0, **changes: Any) -> None:
        fields = {
            "version": 2, "id": id, "incarnation": self.agent.incarnation, "number": number,
            "seen_ns": round(self.now_ns - age_ms * MS), "input": Raw(msgspec.json.encode({"linear": linear})),
        }  # fmt: skip
        self.agent.handle_sample(codec.encode(Sample(**fields | changes)))

    async def driving(self, id: str = "s") -> None:
        """Drive at half a metre per second."""
        self.open(id)
        for number in range(60):
            self.sample(number, id=id)
            await self.tick()
        assert self.speed == 0.5

    @property
    def speed(self) -> float:
        return self.base.sent[-1].linear

    @property
    def counts(self) -> StreamCounts:
        stream = self.end("s").stream
        assert stream is not UNSET
        return stream


async def test_samples_drive_the_base_and_the_stream_is_one_command() -> None:
    bench = Streamed()
    await bench.driving()
    await bench.tick(0.12)
    assert bench.states("s") == ["running"]
    assert bench.counts == StreamCounts(applied=60)


async def test_silence_brakes_within_the_limits_and_the_next_sample_drives_on() -> None:
    bench = Streamed()
    await bench.driving()
    await bench.tick(0.18)
    assert bench.speed == 0.5
    await bench.tick(0.03)
    assert bench.speed < 0.5
    await bench.tick(0.4)
    assert bench.base.sent[-1] == STANDING
    assert bench.counts.silent
    assert max(bench.decelerations) <= LIMITS.linear_acceleration + 1e-9
    bench.sample(60)
    await bench.tick(0.12)
    assert bench.speed > 0
    assert not bench.counts.silent


async def test_a_stream_without_any_sample_ends() -> None:
    bench = Streamed()
    await bench.driving()
    await bench.tick(1.9)
    assert bench.states("s") == ["running"]
    await bench.tick(0.2)
    assert bench.states("s") == ["running", "failed"]
    assert bench.end("s").reason == "no sample came for 2 s"


@pytest.mark.parametrize(
    ("count", "given"),
    [
        ("late", {"age_ms": 151}),
        ("future", {"age_ms": -1}),
        ("reordered", {"number": 60}),
        ("invalid", {"linear": 1.01}),
        ("invalid", {"linear": "fast"}),
        ("invalid", {"input": Raw(b"[]")}),
        ("invalid", {"input": Raw(b'{"linear": 0.1, "sideways": 1}')}),
    ],
)
async def test_a_sample_that_must_not_move_is_dropped_and_counted(count: str, given: dict[str, Any]) -> None:
    bench = Streamed()
    await bench.driving()
    bench.sample(60, 0.5)
    bench.sample(**{"number": 61, "linear": -0.5} | given)
    await bench.tick(0.12)
    assert bench.speed == 0.5
    assert msgspec.structs.asdict(bench.counts)[count] == 1
    assert bench.counts.applied == 61


async def test_a_sample_as_old_as_the_limit_is_applied() -> None:
    bench = Streamed()
    bench.open()
    bench.sample(0, age_ms=150)
    await bench.tick(0.12)
    assert bench.counts.applied == 1


async def test_late_samples_keep_a_stream_open_and_do_not_drive() -> None:
    bench = Streamed()
    await bench.driving()
    for number in range(60, 360):
        bench.sample(number, age_ms=400)
        await bench.tick()
    assert bench.states("s") == ["running"]
    assert bench.base.sent[-1] == STANDING
    assert bench.counts.late == 300


@pytest.mark.parametrize("payload", [b"", b"{}", b"\xff", b'{"version": 7}', b"[" * 4000])
async def test_what_is_no_sample_is_ignored(payload: bytes) -> None:
    bench = Streamed()
    await bench.driving()
    bench.agent.handle_sample(payload)
    await bench.tick(0.12)
    assert bench.counts == StreamCounts(applied=60)


@pytest.mark.parametrize("way", ["stop", "gateway", "protective stop", "newer stream", "newer request"])
async def test_samples_of_a_stream_that_was_told_to_end_move_nothing(way: str) -> None:
    """The earlier driver goes on to send, and two never mix."""
    bench = Streamed()
    await bench.driving()
    if way == "stop":
        bench.stop("stop")
    elif way == "gateway":
        bench.link.gateway_present = False
    elif way == "protective stop":
        bench.base.prevents_motion = "the gate is open"
    elif way == "newer stream":
        bench.open("t")
    else:
        bench.drive("t", linear=0.0)
    for number in range(60, 120):
        bench.sample(number)
        await bench.tick()
        assert number == 60 or bench.speed < 0.5
    assert bench.base.sent[-1] == STANDING
    assert max(bench.decelerations) <= LIMITS.linear_acceleration + 1e-9
    ended = bench.states("s")[-1]
    assert ended == ("cancelled" if way == "stop" else "preempted" if "newer" in way else "failed")
    assert bench.counts.applied == 60 + (way in ("gateway", "protective stop")), "the agent notices in its next tick"


async def test_a_newer_stream_takes_over_the_robot_and_not_the_speed() -> None:
    bench = Streamed()
    await bench.driving()
    bench.open("t")
    await bench.tick(0.05)
    assert 0 < bench.speed < 0.5, "what the earlier driver wanted holds no longer"
    bench.sample(0, 0.8, id="t")
    await bench.tick(0.1)
    assert bench.speed > 0.5
    assert bench.states("s")[-1] == "preempted"


async def test_another_run_and_another_stream_are_ignored() -> None:
    bench = Streamed()
    await bench.driving()
    bench.sample(60, -0.5, incarnation=5)
    bench.sample(60, -0.5, id="other")
    await bench.tick(0.12)
    assert bench.counts.applied == 60
    assert bench.speed == 0.5


async def test_an_agent_that_was_paused_applies_nothing_that_waited() -> None:
    bench = Streamed()
    await bench.driving()
    old_ns = bench.now_ns
    bench.now_ns += 1_000 * MS
    bench.sample(60, 1.0, seen_ns=old_ns)
    await bench.tick()
    assert bench.speed < 0.5
    assert bench.base.ramp.velocity.linear < 0.5


async def test_an_action_without_a_stream_is_not_opened_as_one() -> None:
    refused = Bench().operate("s", "think", None, stream=True)
    assert isinstance(refused, Refused)
    assert (refused.code, refused.reason) == ("unknown-action", "hand.think takes no stream")


def test_a_stream_is_declared_with_its_limits_and_only_where_a_method_can_follow_it() -> None:
    drive = declare(Driven().base).said.actions["drive"]
    assert drive.stream == StreamLimits(age_s=0.15, silence_s=0.2, end_s=2.0)

    class Plain(Component):
        @action(stream=StreamLimits())
        def go(self, speed: float = 0.0) -> None: ...

    with pytest.raises(DeclarationError, match=r"plain\.go: it takes a stream, so it must be async"):
        declare(Plain())

    class Wanting(Component):
        @action(stream=StreamLimits())
        async def go(self, call: Call[float], speed: float) -> None: ...

    with pytest.raises(DeclarationError, match="needs an input without required members"):
        declarations_of([Wanting()], [], [])


async def test_of_waiting_samples_the_newest_is_read() -> None:
    stream = InputStream(StreamLimits(), lambda payload: msgspec.json.decode(payload), 0)
    for number in range(5):
        stream.offer(_sample(number), 0)
    given = await asyncio.wait_for(anext(stream), 1)
    assert given is not None
    assert (given.input, given.until_s) == ({"number": 4}, 0.2)


def _sample(number: int) -> Sample:
    given = Raw(msgspec.json.encode({"number": number}))
    return Sample(version=2, id="s", incarnation=1, number=number, seen_ns=0, input=given)


class BadLink:
    """Samples on their way: 5 % are lost, some phases delay each by about 200 ms, and each overtakes others."""

    def __init__(self, seed: int) -> None:
        self._random = random.Random(seed)
        self._under_way: list[tuple[float, int, float, int]] = []
        self._until_s, self._delay_s = 0.0, 0.0

    def send(self, now_s: float, number: int, speed: float, age_ns: int) -> None:
        if now_s >= self._until_s:
            self._until_s = now_s + self._random.uniform(0.2, 1.5)
            self._delay_s = self._random.choice([0.005, 0.02, 0.06, 0.2, math.inf])
        if self._random.random() >= 0.05:
            arrives_s = now_s + self._delay_s * self._random.uniform(0.5, 1.5)
            self._under_way.append((arrives_s, number, speed, age_ns))

    def arriving(self, now_s: float) -> list[tuple[float, int, float, int]]:
        due = [each for each in self._under_way if each[0] <= now_s]
        self._under_way = [each for each in self._under_way if each[0] > now_s]
        return sorted(due)


@pytest.mark.parametrize("block", range(10))
async def test_nothing_late_moves_whatever_the_link_does(block: int) -> None:
    """200 seeds: what drives is never late nor out of order, and without it braking begins within 100 ms."""
    applied = [await _drive_over_a_bad_link(seed) for seed in range(block * 20, block * 20 + 20)]
    assert sum(applied) > 20 * 20, "most of the links drive at times"


async def _drive_over_a_bad_link(seed: int) -> int:
    """Return how many samples were applied."""
    bench, link, choose = Streamed(), BadLink(seed), random.Random(~seed)
    bench.open()
    await bench.tick()
    newest, valid_s, applied = -1, -math.inf, 0
    speeds: list[tuple[float, float]] = []
    shown_ns = bench.now_ns
    for step in range(600):
        now_s = bench.now_ns / 1e9
        if step % 3 == 0:  # the person's device shows the robot with a delay of its own
            shown_ns = max(shown_ns, round(bench.now_ns - choose.uniform(5, 60) * MS))
            link.send(now_s, step, choose.choice([-1.0, 0.3, 0.8, 1.0]), shown_ns)
        for _, number, speed, seen_ns in link.arriving(now_s):
            is_open = bench.states("s") == ["running"]
            bench.sample(number, speed, seen_ns=seen_ns)
            if is_open and bench.now_ns - seen_ns <= 150 * MS and number > newest:
                newest, valid_s, applied = number, now_s, applied + 1
        before = abs(bench.speed)
        await bench.tick()
        now_s = bench.now_ns / 1e9
        silent_s = now_s - valid_s
        speeds.append((silent_s, abs(bench.speed) - before))
        if silent_s > 0.2 + 0.1:
            assert abs(bench.speed) < before or bench.speed == 0, f"seed {seed}: it does not brake at {now_s:.2f} s"
    await bench.tick(0.2)
    assert bench.counts.applied == applied, f"seed {seed}"
    assert all(change <= 1e-9 for silent_s, change in speeds if silent_s > 0.2 + TICK_S), f"seed {seed}: stale motion"
    bench.stop("end")
    await bench.tick(1)
    return applied
