"""The frames that are kept: the latest ones, for the robot's joints, in bounded memory."""

import asyncio
import math
import time
from typing import Literal

import pytest

from linked_fleet_agent.wire.codec import encode_state, layout
from linked_fleet_agent.wire.messages import WIRE_VERSION, Description, State
from linked_fleet_gateway.extensions.history import recorder
from linked_fleet_gateway.extensions.history.recorder import History
from linked_fleet_gateway.extensions.history.thinning import gap_after, spaced
from linked_fleet_gateway.extensions.history.track import wall_ns
from linked_fleet_runtime import background
from linked_fleet_state.events import Frames
from linked_fleet_state.fleet import Appeared, Described, Fleet, Framed, Vanished

S = 1_000_000_000
JOINTS = tuple(f"j{number}" for number in range(3))


def urdf(name: str = "r") -> str:
    links = "".join(f"<link name='l{number}'/>" for number in range(len(JOINTS) + 1))
    joints = "".join(
        f"<joint name='{each}' type='continuous'><parent link='l{n}'/><child link='l{n + 1}'/></joint>"
        for n, each in enumerate(JOINTS)
    )
    return f"<robot name='{name}'>{links}{joints}</robot>"


def said(
    robot: str,
    run: int = 1,
    model: str = "r",
    joints: tuple[str, ...] = JOINTS,
    base: Literal["fixed", "floating"] = "fixed",
) -> Described:
    return Described(
        Description(
            version=WIRE_VERSION, robot=robot, incarnation=run, title="R", urdf=urdf(model), joints=joints, rate_hz=50,
            layout=layout(len(joints), base == "floating"), base=base,
        )
    )  # fmt: skip


def frame(sequence: int, run: int = 1, value: float = 0.0) -> bytes:
    row = (value,) * len(JOINTS)
    return encode_state(
        State(
            incarnation=run, sequence=sequence, monotonic_ns=1, wall_ns=sequence * S // 10,
            positions=row, velocities=row, efforts=row,
        )
    )  # fmt: skip


def make(*robots: str, span_s: float = 300, most_bytes: int = 10**6) -> tuple[Fleet, History]:
    fleet = Fleet(Frames())
    for robot in robots:
        for event in (Appeared(robot, 1), said(robot), Framed(robot, frame(1))):
            fleet.apply(event, 1)
    return fleet, History(fleet, span_s, 10, most_bytes)


def look(history: History, fleet: Fleet) -> None:
    """Do what the timer does."""
    for latest in fleet.frames.latest_frames():
        history.sample(latest)


def stamps(history: History, fleet: Fleet, robot: str = "r") -> list[int]:
    track = history.track(fleet.robots[robot])
    return [] if track is None else [wall_ns(each) * 10 // S for each in track.excerpt(None, None, 10**6).frames]


def test_each_look_keeps_the_latest_frame_and_no_frame_twice() -> None:
    fleet, history = make("r")
    look(history, fleet)
    look(history, fleet)
    for sequence in (2, 3, 4):
        assert fleet.frames.put("r", frame(sequence), 1)
    look(history, fleet)
    assert stamps(history, fleet) == [1, 4]


def test_another_run_of_the_same_robot_goes_on_with_its_history() -> None:
    fleet, history = make("r")
    look(history, fleet)
    for event in (Vanished("r", 1), Appeared("r", 2), Framed("r", frame(5, run=2))):
        fleet.apply(event, 1)
    look(history, fleet)
    assert stamps(history, fleet) == [1]  # the joints of the new run's frames are still unknown
    fleet.apply(said("r", run=2), 1)
    look(history, fleet)
    assert stamps(history, fleet) == [1, 5]


@pytest.mark.parametrize(("model", "joints"), [("other", JOINTS), ("r", JOINTS[::-1])])
def test_other_joints_are_another_history(model: str, joints: tuple[str, ...]) -> None:
    fleet, history = make("r")
    look(history, fleet)
    fleet.apply(said("r", model=model, joints=joints), 1)
    assert fleet.frames.put("r", frame(2), 1)
    look(history, fleet)
    assert stamps(history, fleet) == [2]
    assert history.bytes == len(frame(2)) + 41


def test_frames_with_a_fixed_base_are_no_history_of_a_robot_whose_base_floats_now() -> None:
    fleet, history = make("r")
    look(history, fleet)
    for event in (Vanished("r", 1), Appeared("r", 2), said("r", run=2, base="floating")):
        fleet.apply(event, 1)
    look(history, fleet)
    assert stamps(history, fleet) == [], "they have no pose of the base"


async def test_a_robot_that_describes_itself_anew_between_two_slices_of_a_look_keeps_no_foreign_frame(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    fleet, history = make("a", "b")
    monkeypatch.setattr(background, "SLICE_S", -1.0)
    looking = asyncio.create_task(history._sample_all())
    while not stamps(history, fleet, "a"):  # noqa: ASYNC110
        await asyncio.sleep(0)
    for event in (Vanished("b", 1), Appeared("b", 2), said("b", run=2, joints=JOINTS[:1])):
        fleet.apply(event, 1)
    await looking
    assert stamps(history, fleet, "b") == []


def test_the_history_of_a_robot_that_left_stays() -> None:
    fleet, history = make("r")
    look(history, fleet)
    fleet.apply(Vanished("r", 1), 1)
    look(history, fleet)
    assert stamps(history, fleet) == [1]


def _recorded(history: History, fleet: Fleet, rounds: int) -> None:
    """Send frames of all robots, each seen by a running history, which is then ended."""

    async def run() -> None:
        async with history:
            for sequence in range(2, 2 + rounds):
                for robot in fleet.robots:
                    fleet.frames.put(robot, frame(sequence, value=math.nan), 1)
                while any(stamps(history, fleet, robot)[-1:] != [sequence] for robot in fleet.robots):  # noqa: ASYNC110
                    await asyncio.sleep(0.001)
                assert history.bytes <= history.most_bytes + len(fleet.robots) * (len(frame(1)) + 41)

    asyncio.run(run())


def test_many_robots_stay_within_their_memory_and_all_keep_what_is_old_and_what_is_new() -> None:
    robots = [f"r{number}" for number in range(40)]
    fleet, history = make(*robots, most_bytes=40 * 12 * (len(frame(1)) + 41))
    history.rate_hz = 1000
    _recorded(history, fleet, 100)
    assert history.samples > 40 * 6
    for robot in robots:
        kept = stamps(history, fleet, robot)
        assert kept[-2:] == [100, 101] and kept[0] < 60
    assert history.bytes == history.samples * (len(frame(1)) + 41)


async def test_a_robot_that_falls_silent_has_a_gap_and_none_twice(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    fleet, history = make("r")
    await history._sample_all()
    monkeypatch.setattr(time, "monotonic", lambda: 1e9)
    for _ in range(3):
        await history._sample_all()
    track = history.track(fleet.robots["r"])
    assert track is not None
    assert track.excerpt(None, None, 9).frames == (frame(1), gap_after(frame(1)))
    assert fleet.frames.put("r", frame(50), 1)
    await history._sample_all()
    assert track.excerpt(None, None, 9).frames == (frame(1), gap_after(frame(1)), frame(50))


def test_spaced_frames_keep_what_ends_before_a_gap() -> None:
    gap = gap_after(frame(3))
    given = [frame(1), frame(2), frame(3), gap, frame(50), frame(51), frame(60), frame(61)]
    assert spaced(given, S // 2) == (frame(1), frame(3), gap, frame(50), frame(60), frame(61))
    assert spaced(given, S // 2, with_last=False) == (frame(1), frame(3), gap, frame(50), frame(60))
    assert spaced(given, 0) == tuple(given)
    assert spaced([], S) == ()


def test_a_pause_between_two_frames_is_a_gap() -> None:
    fleet, history = make("r")
    look(history, fleet)
    assert fleet.frames.put("r", frame(50), 1)
    look(history, fleet)
    track = history.track(fleet.robots["r"])
    assert track is not None
    assert track.excerpt(None, None, 9).frames == (frame(1), gap_after(frame(1)), frame(50))


@pytest.mark.parametrize("stamp_ns", [2**63 - 1, 2**63 - 2, 4_000_000_000 * S])
async def test_frames_of_the_future_are_refused_counted_and_cost_no_other_robot(
    stamp_ns: int, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    fleet, history = make("a", "b")
    await history._sample_all()
    for sequence in (2, 3):
        ahead = encode_state(
            State(
                incarnation=1, sequence=sequence, monotonic_ns=1, wall_ns=stamp_ns,
                positions=(0.0,) * 3, velocities=(0.0,) * 3, efforts=(0.0,) * 3,
            )
        )  # fmt: skip
        assert fleet.frames.put("a", ahead, 1) and fleet.frames.put("b", frame(sequence), 1)
        for _ in range(2):
            await history._sample_all()
    assert (stamps(history, fleet, "a"), stamps(history, fleet, "b")) == ([1], [1, 2, 3])
    assert history.ahead == {"a": 2} and "too far ahead" in history.findings[0]
    assert len([each for each in caplog.messages if "its clock is ahead" in each]) == 1
    monkeypatch.setattr(time, "monotonic", lambda: 1e9)
    await history._sample_all()
    assert all(len(history._tracks[each]) == count for each, count in (("a", 2), ("b", 4))), "the gaps"
    assert fleet.frames.put("a", frame(4), 1)
    look(history, fleet)
    assert history.ahead == {} and history.findings == []


async def test_the_gap_of_one_robot_that_fails_costs_no_other(monkeypatch: pytest.MonkeyPatch) -> None:
    _, history = make("a", "b")
    await history._sample_all()
    monkeypatch.setattr(history._tracks["a"], "heard_s", -1e9)
    monkeypatch.setattr(history._tracks["b"], "heard_s", -1e9)
    usual = recorder.gap_after

    def gap(frame: bytes) -> bytes:
        if frame is history._tracks["a"].heard:
            raise ValueError("no gap")
        return usual(frame)

    monkeypatch.setattr(recorder, "gap_after", gap)
    await history._sample_all()
    assert (len(history._tracks["a"]), len(history._tracks["b"])) == (1, 2)
    assert "no gap" in history._faults.find("History", "a", "the gap")


async def test_nothing_is_recorded_with_a_span_of_zero() -> None:
    fleet, history = make("r", span_s=0)
    async with history:
        await asyncio.sleep(0)
    assert (history.bytes, history.samples, history.track(fleet.robots["r"])) == (0, 0, None)
