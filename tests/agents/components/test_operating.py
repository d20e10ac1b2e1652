"""What an agent does with requests of components: who begins, who gives way, who must end, and what is told."""

import asyncio
import threading
from typing import Any

import msgspec
import pytest
from msgspec import Raw

from component_agent import Bench, Done
from linked_fleet_agent.components import Call, CancelledActionError, Component, action, value
from linked_fleet_agent.wire import codec
from linked_fleet_agent.wire.components import Values
from linked_fleet_agent.wire.messages import Accepted, Refused, Reply


def accepted(reply: Reply) -> Accepted:
    assert isinstance(reply, Accepted), reply
    return reply


async def test_an_action_runs_reports_and_ends_with_its_result() -> None:
    bench = Bench()
    accepted(bench.operate("g", given={"force": 30}))
    await bench.tick(0.3)
    running = bench.end("g")
    assert (running.state, running.progress, running.reason) == ("running", 0.5, "closing")
    assert running.feedback == Raw(b'{"at":30.0}')
    bench.hand.position = 0.02
    bench.hand.open_.set()
    await bench.tick(0.02)
    assert bench.states("g") == ["running", "succeeded"]
    assert (bench.end("g").result, bench.end("g").progress) == (Raw(b'{"at":0.02}'), 1.0)


@pytest.mark.parametrize(
    ("action", "given", "changes", "code", "said"),
    [
        ("grasp", {"force": 60}, {}, "input", "force: 60 is above 50"),
        ("grasp", {"strength": 6}, {}, "input", "'strength' is unknown; the members are force"),
        ("grasp", [1], {}, "input", "[1] is not an object"),
        ("release", {"x": 1}, {}, "input", "this action has no input"),
        ("last", None, {}, "input", "'seconds' is missing"),
        ("jump", None, {}, "unknown-action", "hand has no action 'jump'; it has grasp, release"),
        ("grasp", None, {"component": "foot"}, "unknown-action", "no component 'foot'; it has hand"),
        ("grasp", None, {"property": "light"}, "unknown-action", "either an action or a property"),
        ("", True, {"property": "width"}, "unknown-action", "no property that can be set, 'width'; it has light"),
        ("", 1, {"property": "light"}, "input", "1 is not true or false"),
        ("", None, {"property": "light"}, "input", "null is no value"),
        ("grasp", None, {"incarnation": 1}, "incarnation", "the command is for run 1"),
        ("grasp", None, {"seen_ns": 0, "time_to_live_ns": 1}, "stale", "its time to live"),
        ("grasp", None, {"seen_ns": 2**62}, "stale", "ahead of this agent's monotonic clock"),
        ("grasp", None, {"version": 1}, "version", "version 1 is not supported; these messages have version 2"),
        ("grasp", None, {"id": "ü"}, "malformed", "matching regex"),
        ("grasp", "x" * 70_000, {}, "input", "65536 is the maximum"),
    ],
)
async def test_requests_that_are_refused_say_why(
    action: str, given: object, changes: dict[str, Any], code: str, said: str
) -> None:
    bench = Bench()
    reply = bench.operate(changes.pop("id", "g"), action, given, **changes)
    assert isinstance(reply, Refused)
    assert (reply.code, said in reply.reason) == (code, True), reply
    await bench.tick()
    assert bench.hand.begun == []


async def test_no_id_runs_twice() -> None:
    bench = Bench()
    accepted(bench.operate("g"))
    repeated = bench.operate("g")
    assert isinstance(repeated, Refused)
    assert repeated.code == "repeated"
    await bench.tick()
    assert bench.hand.begun == ["grasp"]


async def test_a_rehearsal_runs_nothing_and_says_what_the_driver_says() -> None:
    bench = Bench()
    assert accepted(bench.operate("a", "last", {"seconds": 2}, rehearsal=True)).duration_s == 4.0
    assert accepted(bench.operate("b", "grasp", rehearsal=True)).duration_s == 0.0
    await bench.tick()
    assert (bench.hand.begun, bench.link.progress) == ([], [])
    accepted(bench.operate("b"))  # the id stays unused


async def test_a_property_is_set() -> None:
    bench = Bench()
    accepted(bench.operate("s", "", True, property="light"))
    await bench.tick(0.03)
    assert bench.states("s") == ["running", "succeeded"]
    assert bench.link.values[-1].components["hand"].values == {"light": Raw(b"true")}


@pytest.mark.parametrize(
    ("action", "said"),
    [("fail", "no bus"), ("lie", 'it has ended, but its result is not what it declares: "nothing" is not an object')],
)
async def test_what_a_component_raises_or_returns_wrongly_fails_its_action(action: str, said: str) -> None:
    bench = Bench()
    accepted(bench.operate("f", action))
    await bench.tick(0.02)
    assert (bench.end("f").state, bench.end("f").reason) == ("failed", said)


async def test_an_action_that_takes_too_long_is_cancelled() -> None:
    bench = Bench()
    accepted(bench.operate("g"))
    await bench.tick(20.1)
    assert (bench.end("g").state, bench.end("g").reason) == (
        "failed",
        "it did not end within the 20 s that it may take",
    )


STOPS: list[dict[str, Any]] = [{}, {"joints": ("finger",)}, {"command": "g"}]


@pytest.mark.parametrize("stop", STOPS)
async def test_a_stop_ends_what_moves(stop: dict[str, Any]) -> None:
    bench = Bench()
    accepted(bench.operate("g"))
    accepted(bench.operate("t", "think"))
    await bench.tick()
    assert accepted(bench.stop("s", reason="enough", rehearsal=True, **stop)).preempts == ("g",)
    assert accepted(bench.stop("s", reason="enough", **stop)).preempts == ("g",)
    await bench.tick(0.4)
    ended = bench.end("g")
    assert (ended.state, ended.reason, ended.successor) == ("cancelled", "enough", "s")
    assert bench.states("s") == ["running", "succeeded"]
    assert bench.states("t") == ["running"]


async def test_a_stop_of_other_joints_leaves_an_action_alone() -> None:
    bench = Bench()
    accepted(bench.operate("g"))
    await bench.tick()
    assert accepted(bench.stop("s", joints=("arm",))).preempts == ()
    await bench.tick(0.4)
    assert bench.states("g") == ["running"]


async def test_a_stop_by_id_ends_what_moves_nothing() -> None:
    bench = Bench()
    accepted(bench.operate("t", "think"))
    await bench.tick()
    accepted(bench.stop("s", command="t"))
    await bench.tick(0.05)
    assert (bench.end("t").state, bench.end("s").state) == ("cancelled", "succeeded")


async def test_a_request_from_before_a_stop_is_stale() -> None:
    bench = Bench()
    seen_ns = bench.link.states[-1].monotonic_ns
    accepted(bench.stop("s"))
    for name in ("grasp", "roll"):
        late = bench.operate(name, name, seen_ns=seen_ns)
        assert isinstance(late, Refused)
        assert late.code == "stale"
    accepted(bench.operate("think", "think", seen_ns=seen_ns))


async def test_an_action_that_ignores_a_stop_is_a_fault_until_it_ends() -> None:
    bench = Bench()
    bench.hand.ignore = True
    accepted(bench.operate("g"))
    await bench.tick()
    accepted(bench.stop("s"))
    await bench.tick(0.4)
    assert bench.states("s") == ["running"]
    await bench.tick(0.3)
    said = "hand.grasp was told to end"
    assert said in bench.link.conditions[-1].fault
    refused = bench.move("m", arm=1.0)
    assert isinstance(refused, Refused)
    assert (refused.code, said in refused.reason) == ("fault", True)
    await bench.tick(2)
    assert (bench.end("s").state, bench.end("s").reason) == ("failed", "hand.grasp has not ended")
    bench.hand.open_.set()
    await bench.tick(0.05)
    assert bench.end("g").state == "cancelled"
    assert bench.link.conditions[-1].fault == ""
    accepted(bench.move("m2", arm=1.0))


@pytest.mark.parametrize("what", ["gateway", "fault", "pause", "end"])
async def test_what_makes_a_robot_hold_ends_what_moves(what: str) -> None:
    bench = Bench()
    accepted(bench.operate("g"))
    accepted(bench.operate("r", "roll"))
    accepted(bench.operate("t", "think"))
    await bench.tick()
    if what == "gateway":
        bench.link.gateway_present = False
    elif what == "fault":
        bench.robot.faulty = True
    elif what == "pause":
        bench.now_ns += 10_000_000_000
    await bench.tick(0.05)
    if what == "end":
        running = asyncio.create_task(bench.agent.run(bench.link))
        await asyncio.sleep(0)
        running.cancel()
        await asyncio.wait([running])
    assert (bench.end("g").state, bench.end("r").state) == ("failed", "failed")
    assert bench.end("t").state == ("failed" if what == "end" else "running")
    if what in ("gateway", "fault"):
        assert isinstance(bench.operate("g2"), Refused)


async def test_the_later_of_two_that_move_the_same_waits_for_the_end_of_the_earlier() -> None:
    bench = Bench()
    bench.hand.ignore = True
    accepted(bench.operate("g"))
    await bench.tick()
    assert accepted(bench.operate("r", "release")).preempts == ("g",)
    await bench.tick(0.2)
    assert bench.hand.begun == ["grasp"]
    bench.hand.open_.set()
    await bench.tick(0.03)
    assert bench.hand.begun == ["grasp", "release"]
    assert (bench.end("g").state, bench.end("g").successor) == ("preempted", "r")
    assert bench.states("r") == ["running", "succeeded"]


async def test_a_motion_of_a_joint_waits_for_the_action_that_moves_it() -> None:
    bench = Bench()
    bench.hand.ignore = True
    accepted(bench.operate("g"))
    await bench.tick()
    assert accepted(bench.move("m", finger=0.5)).preempts == ("g",)
    await bench.tick(0.2)
    assert bench.robot.positions["finger"] == 0.0
    bench.hand.open_.set()
    await bench.tick(2)
    assert bench.robot.positions["finger"] == pytest.approx(0.5, abs=1e-3)
    assert bench.states("m") == ["running", "succeeded"]


async def test_an_action_waits_until_the_joints_that_it_takes_over_have_braked() -> None:
    bench = Bench()
    accepted(bench.move("m", finger=2.0))
    await bench.tick(0.5)
    assert accepted(bench.operate("g")).preempts == ("m",)
    await bench.tick()
    assert bench.hand.begun == []
    await bench.tick(1)
    stands = bench.robot.positions["finger"]
    assert bench.hand.begun == ["grasp"]
    await bench.tick(0.5)
    assert bench.robot.positions["finger"] == stands
    assert (bench.end("m").state, bench.end("m").successor) == ("preempted", "g")


async def test_what_waits_is_stopped_too_and_fails_if_it_waits_too_long() -> None:
    bench = Bench()
    bench.hand.ignore = True
    accepted(bench.operate("g"))
    await bench.tick()
    accepted(bench.move("m", finger=0.5))
    await bench.tick(0.02)
    assert set(accepted(bench.stop("s")).preempts) == {"g", "m"}
    await bench.tick(0.02)
    assert bench.end("m").state == "cancelled"

    other = Bench()
    other.hand.ignore = True
    accepted(other.operate("g"))
    await other.tick()
    accepted(other.move("m", finger=0.5))
    await other.tick(3)
    assert other.end("m").state == "failed"
    assert "hand.grasp was told to end" in other.end("m").reason
    assert other.robot.positions["finger"] == 0.0


async def test_motions_of_other_joints_run_beside_an_action() -> None:
    bench = Bench()
    accepted(bench.operate("g"))
    assert accepted(bench.move("m", arm=0.5)).preempts == ()
    await bench.tick(3)
    assert bench.states("m") == ["running", "succeeded"]
    assert bench.states("g") == ["running"]


class Guard(Component, blocking=False):
    """Prevents motion while a test says so."""

    @value
    def tripped(self) -> bool:
        return bool(self.prevents_motion)


async def test_a_component_that_prevents_motion_ends_what_moves_and_refuses_more() -> None:
    guard = Guard()
    bench = Bench(guard)
    accepted(bench.operate("g"))
    accepted(bench.move("m", arm=2.0))
    await bench.tick(0.2)
    guard.prevents_motion = "a protective stop is active"
    await bench.tick(0.5)
    assert [bench.end(each).reason for each in ("g", "m")] == ["guard: a protective stop is active"] * 2
    for refused in (bench.operate("g2"), bench.move("m2", arm=0.0)):
        assert isinstance(refused, Refused)
        assert refused.reason == "guard: a protective stop is active"
    accepted(bench.operate("t", "think"))
    guard.prevents_motion = ""
    accepted(bench.move("m3", arm=0.0))


async def test_values_are_published_when_they_change_and_renewed_while_they_do_not() -> None:
    bench = Bench()

    def told() -> list[dict[str, Raw]]:
        return [each.components["hand"].values for each in bench.link.values if "hand" in each.components]

    assert told() == [{"width": Raw(b"0.0"), "light": Raw(b"false")}]
    await bench.tick(0.5)
    assert len(told()) == 1
    bench.hand.position = 0.03
    await bench.tick(0.02)
    assert told()[1] == {"width": Raw(b"0.03")}
    await bench.tick(3.1)
    assert told()[2:] == [{}, {}, {}]
    sequences = [each.sequence for each in bench.link.values]
    assert sequences == [*range(1, len(sequences) + 1)]
    everything = codec.decode(bench.agent.values(), Values)
    assert everything.components["hand"].values == {"width": Raw(b"0.03"), "light": Raw(b"false")}
    assert everything.sequence == sequences[-1]


async def test_a_value_that_cannot_be_read_or_is_not_as_declared_is_unknown_and_says_why() -> None:
    bench = Bench()
    bench.hand.broken = "no bus"
    await bench.tick(0.02)
    [said] = bench.link.values[-1].components.values()
    assert (said.values, said.fault) == ({"width": Raw(b"null")}, "width cannot be read: no bus")
    bench.hand.broken, bench.hand.position = "", -1.0
    await bench.tick(0.02)
    [said] = bench.link.values[-1].components.values()
    assert said.fault == "width is not what is declared: -1.0 M is below 0 M"
    bench.hand.position = float("nan")
    await bench.tick(0.02)
    assert bench.link.values[-1].components["hand"].fault == ""
    bench.hand.position = 0.5
    await bench.tick(0.02)
    assert bench.link.values[-1].components["hand"].values == {"width": Raw(b"0.5")}


async def test_events_are_published_in_their_order_and_a_gap_shows_those_that_were_not() -> None:
    bench = Bench()
    bench.hand.dropped(Done(0.1))
    bench.hand.told()
    await bench.tick()
    assert [(each.event, each.data, each.sequence) for each in bench.link.events] == [
        ("dropped", Raw(b'{"at":0.1}'), 0), ("told", msgspec.UNSET, 1),
    ]  # fmt: skip
    for _ in range(300):
        bench.hand.told()
    await bench.tick(1)
    assert bench.link.events[-1].sequence == 301
    assert len(bench.link.events) == 258


class Slow(Component, rate_hz=100):
    """Blocks wherever it can."""

    def __init__(self) -> None:
        self.go, self.reading = threading.Event(), threading.Event()
        self.done: list[str] = []

    @value
    def level(self) -> int:
        self.reading.wait(10)
        return 7

    @action()
    def work(self, call: Call[None], hard: bool = True) -> int:
        try:
            while not self.go.is_set():
                call.sleep(0.01)
        except CancelledActionError:
            self.done.append("cancelled")
            raise
        return 42


async def test_what_blocks_runs_in_threads_and_the_loop_goes_on() -> None:
    slow = Slow()
    bench = Bench(slow)
    accepted(bench.operate("w", "work", component="slow"))
    accepted(bench.operate("x", "work", component="slow"))
    await bench.tick(0.1)
    assert [each for message in bench.link.values for each in message.components] == ["hand", "jogging"]
    slow.reading.set()
    await bench.until(lambda: "slow" in bench.link.values[-1].components)
    assert bench.link.values[-1].components["slow"].values == {"level": Raw(b"7")}
    accepted(bench.stop("s", command="x"))
    await bench.until(lambda: bench.states("x") == ["running", "cancelled"])
    assert slow.done == ["cancelled"]
    slow.go.set()
    await bench.until(lambda: bench.states("w") == ["running", "succeeded"])
    assert bench.end("w").result == Raw(b"42")
