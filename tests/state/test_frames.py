"""Frames stored outside the event loop: which are accepted, judged first, or reported at once."""

import math

import pytest

from linked_fleet_agent.wire.codec import encode_state, layout
from linked_fleet_agent.wire.messages import WIRE_VERSION, Description, State
from linked_fleet_state.events import Frames
from linked_fleet_state.fleet import Appeared, Described, DescriptionRejected, Fleet, Framed, Robot, Vanished

URDF = """<robot name='r'><link name='a'/><link name='b'/>
<joint name='turn' type='continuous'><parent link='a'/><child link='b'/><axis xyz='0 0 1'/></joint></robot>"""


def said(run: int = 5, title: str = "R") -> Description:
    return Description(
        version=WIRE_VERSION, robot="r", incarnation=run, title=title, urdf=URDF, joints=("turn",), rate_hz=50,
        layout=layout(1, False),
    )  # fmt: skip


def frame(sequence: int, turn: float = 0.0, *, run: int = 5, joints: int = 1, monotonic_ns: int = 1) -> bytes:
    row = (turn,) * joints
    return encode_state(
        State(
            incarnation=run, sequence=sequence, monotonic_ns=monotonic_ns, wall_ns=1000 + sequence,
            positions=row, velocities=row, efforts=(math.nan,) * joints,
        )
    )  # fmt: skip


@pytest.fixture
def fleet() -> Fleet:
    """Return a fleet with one robot, whose first frame has been judged."""
    fleet = Fleet(Frames(lambda robot: f"key/{robot}"))
    for event in (Appeared("r", 5), Described(said()), Framed("r", frame(1, 0.1))):
        fleet.apply(event, 1)
    return fleet


def put(fleet: Fleet, payload: bytes, now_ns: int = 2) -> bool:
    return fleet.frames.put("key/r", payload, now_ns)


def robot(fleet: Fleet) -> Robot:
    return fleet.robots["r"]


def test_reading_a_robot_returns_its_latest_frame(fleet: Fleet) -> None:
    held = robot(fleet)
    assert put(fleet, frame(2, 0.2), 7)
    assert (held.positions["turn"], held.sequence, held.last_seen_ns) == (0.1, 1, 7)
    assert (robot(fleet).positions["turn"], held.sequence) == (0.2, 2)
    assert fleet.frames.taken == 1
    assert not held.adopt_latest_frame()


@pytest.mark.parametrize(
    "payload",
    [
        b"",
        frame(3)[:-8],
        frame(3) + bytes(8),
        frame(3, joints=2),
        frame(3, run=4),
        frame(3, run=6),
        frame(1, 0.1),
        frame(0),
        frame(3)[:32] + b"\xff" * 8 + frame(3)[40:],
        frame(3)[:24] + b"\xff" * 8 + frame(3)[32:],
        b"XX" + frame(3)[2:],
        frame(3)[:2] + b"\x09\x00" + frame(3)[4:],
    ],
)
def test_an_unchecked_frame_is_judged_and_replaces_nothing(fleet: Fleet, payload: bytes) -> None:
    assert put(fleet, frame(2, 0.2))
    assert not put(fleet, payload)
    assert fleet.apply(Framed("r", payload), 3) == []
    assert fleet.dropped["r"] + fleet.malformed_counts["r"] == 1
    assert robot(fleet).positions["turn"] == 0.2
    assert put(fleet, frame(3, 0.3))


def test_nothing_of_a_robot_that_is_not_known_is_taken(fleet: Fleet) -> None:
    assert not fleet.frames.put("key/s", frame(1), 1)


def test_a_frame_of_the_run_before_is_not_that_of_this_one(fleet: Fleet) -> None:
    assert put(fleet, frame(2, 0.2))
    fleet.apply(Appeared("r", 6), 3)
    assert not put(fleet, frame(3, 0.3))
    assert math.isnan(robot(fleet).positions["turn"])
    fleet.apply(Framed("r", frame(1, 0.6, run=6)), 4)
    assert put(fleet, frame(2, 0.7, run=6))
    fleet.apply(Described(said(6)), 5)
    assert robot(fleet).positions["turn"] == 0.7
    assert put(fleet, frame(3, 0.8, run=6))


def test_a_robot_that_left_keeps_the_last_frame_that_came(fleet: Fleet) -> None:
    put(fleet, frame(2, 0.2), 9)
    fleet.apply(Vanished("r", 5), 10)
    assert (robot(fleet).positions["turn"], robot(fleet).last_seen_ns) == (0.2, 9)


def test_a_late_frame_is_late_although_nobody_has_looked(fleet: Fleet) -> None:
    put(fleet, frame(7, 0.7))
    assert fleet.apply(Framed("r", frame(5, 0.5)), 3) == []
    assert (fleet.dropped["r"], robot(fleet).sequence) == (1, 7)


def test_a_change_that_no_frame_brought_is_counted_on_from_the_frame_before(fleet: Fleet) -> None:
    put(fleet, frame(4))
    fleet.configure("r", {"title": "Other"})
    assert robot(fleet).news == (5, 1)


def test_a_watched_robot_is_reported_once_until_it_is_read(fleet: Fleet) -> None:
    frames, woken = fleet.frames, list[int]()
    frames.reader.open(lambda: woken.append(1))
    assert put(fleet, frame(2, 0.2))
    assert fleet.next_moved() is None
    frames.watched = {"r"}
    assert put(fleet, frame(3, 0.3))
    assert put(fleet, frame(4, 0.4))
    assert woken == [1]
    robot(fleet)  # something else reads meanwhile
    assert [fleet.next_moved(), fleet.next_moved()] == ["r", None]
    assert put(fleet, frame(5, 0.5))
    assert woken == [1, 1]
    assert fleet.next_moved() == "r"


def test_the_reader_is_woken_again_only_after_it_has_found_nothing(fleet: Fleet) -> None:
    frames, woken = fleet.frames, list[int]()
    frames.reader.open(lambda: woken.append(1))
    frames.watched = {"r"}
    assert put(fleet, frame(2, 0.2))
    assert fleet.next_moved() == "r"
    assert put(fleet, frame(3, 0.3))
    assert woken == [1]
    assert [fleet.next_moved(), fleet.next_moved()] == ["r", None]
    frames.reader.close()
    assert put(fleet, frame(4, 0.4))
    assert woken == [1]


def test_a_frame_that_came_before_somebody_watched_is_reported_later(fleet: Fleet) -> None:
    assert put(fleet, frame(2, 0.2))
    fleet.frames.schedule_missed()
    assert fleet.next_moved() is None
    fleet.frames.watched = {"r"}
    fleet.frames.schedule_missed()
    fleet.frames.schedule_missed()
    assert [fleet.next_moved(), fleet.next_moved()] == ["r", None]
    fleet.frames.schedule_missed()
    assert fleet.next_moved() is None


def test_robots_are_reported_to_listeners_although_nobody_watches_them(fleet: Fleet) -> None:
    fleet.frames.has_listeners = True
    assert put(fleet, frame(2, 0.2))
    assert fleet.next_moved() == "r"


def test_a_robot_that_left_the_fleet_is_not_reported(fleet: Fleet) -> None:
    fleet.frames.watched = {"r"}
    assert put(fleet, frame(2, 0.2))
    fleet.apply(DescriptionRejected("r", 5, "unusable"), 3)
    assert fleet.next_moved() is None
