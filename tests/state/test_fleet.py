"""The fleet's handling of events: presence, runs, descriptions, frames, and the policy of change."""

import gc
import math
import weakref

import msgspec
import pytest

from linked_fleet_agent.wire.codec import encode_state, layout
from linked_fleet_agent.wire.messages import WIRE_VERSION, Base, Description, State
from linked_fleet_state.fleet import (
    DESCRIPTION_WAIT_NS,
    MAX_UNDESCRIBED,
    Appeared,
    Change,
    Described,
    DescriptionRejected,
    Event,
    Fleet,
    Framed,
    Robot,
    Vanished,
)
from linked_fleet_state.observation import Observation, rounded

URDF = """<robot name='r'><link name='a'/><link name='b'/><link name='c'/>
<joint name='turn' type='continuous'><parent link='a'/><child link='b'/><origin xyz='0 0 1'/><axis xyz='0 0 1'/></joint>
<joint name='slide' type='prismatic'><parent link='b'/><child link='c'/><origin xyz='1 0 0'/>
<limit lower='0' upper='1' effort='1' velocity='1'/></joint></robot>"""
JOINTS = ("turn", "slide")


def said(incarnation: int = 5, **changed: object) -> Description:
    base = Description(
        version=WIRE_VERSION,
        robot="r",
        incarnation=incarnation,
        title="R",
        urdf=URDF,
        joints=JOINTS,
        rate_hz=50,
        layout=layout(2, False),
    )
    return msgspec.structs.replace(base, **changed)


def framed(sequence: int, turn: float = 0.0, slide: float = 0.5, *, run: int = 5, base: Base | None = None) -> Framed:
    return Framed(
        "r",
        encode_state(
            State(
                incarnation=run,
                sequence=sequence,
                monotonic_ns=sequence,
                wall_ns=1000 + sequence,
                base=base,
                positions=(turn, slide),
                velocities=(0.0, 0.0),
                efforts=(math.nan, math.nan),
            )
        ),
    )


def fleet_after(*events: Event) -> tuple[Fleet, Robot]:
    fleet = Fleet()
    for now, event in enumerate(events):
        fleet.apply(event, now)
    fleet.show_awaited(DESCRIPTION_WAIT_NS)
    return fleet, fleet.robots["r"]


def kinds(changes: list[Change]) -> list[str]:
    return [change.what for change in changes]


UP = (Appeared("r", 5), Described(said()))


def test_a_robot_comes_goes_and_stays_readable() -> None:
    fleet = Fleet()
    assert fleet.apply(Appeared("r", 5), 1) == [Change("r", "appeared")]
    assert fleet.apply(Described(said()), 2) == [Change("r", "described")]
    assert fleet.apply(framed(1, 0.25), 3) == [Change("r", "frame")]
    assert fleet.apply(Vanished("r", 5), 4) == [Change("r", "vanished")]
    robot = fleet.robots["r"]
    assert (robot.online, robot.last_seen_ns, robot.positions["turn"]) == (False, 3, 0.25)
    assert kinds(fleet.apply(Appeared("r", 5), 5)) == ["appeared"]
    assert robot.positions["turn"] == 0.25


@pytest.mark.parametrize(
    ("event", "changes"),
    [
        (Described(said()), ["described"]),
        (Described(said(urdf="<robot")), ["faulty"]),
        (DescriptionRejected("r", 5, "it is silent"), ["faulty"]),
    ],
)
def test_a_new_robot_is_shown_once_its_description_is_known_or_is_not_to_come(event: Event, changes: list[str]) -> None:
    """So that nobody who has found it misses its joints."""
    fleet = Fleet()
    fleet.apply(Appeared("r", 5), 1)
    assert (list(fleet.robots), fleet.show_awaited(DESCRIPTION_WAIT_NS)) == ([], [])
    assert kinds(fleet.apply(event, 2)) == changes
    assert (list(fleet.robots), fleet.show_awaited(10**12)) == (["r"], [])


def test_a_new_robot_whose_description_does_not_come_is_shown_without_it() -> None:
    fleet = Fleet()
    fleet.apply(Appeared("r", 5), 1)
    assert fleet.show_awaited(1 + DESCRIPTION_WAIT_NS) == [Change("r", "appeared")]
    assert list(fleet.robots) == ["r"]
    fleet.apply(Vanished("r", 5), 10**10)
    fleet.apply(Appeared("r", 6), 10**11)
    fleet.apply(Vanished("r", 6), 10**11)
    assert (list(fleet.robots), fleet.show_awaited(10**12)) == ([], [])


def test_news_that_is_none_changes_nothing() -> None:
    fleet, _ = fleet_after(*UP, framed(1))
    for event in (
        *UP,
        framed(1),
        Vanished("r", 4),
        Vanished("x", 1),
        DescriptionRejected("x", 1, "?"),
        Framed("x", b""),
    ):
        assert fleet.apply(event, 9) == []


def test_robots_are_in_the_order_of_their_names() -> None:
    fleet = Fleet()
    for name in ("c", "a", "b"):
        fleet.apply(Appeared(name, 1), 0)
    fleet.show_awaited(DESCRIPTION_WAIT_NS)
    assert list(fleet.robots) == ["a", "b", "c"]
    assert [robot.name for robot in fleet.robots.values()] == ["a", "b", "c"]


def test_a_new_robot_does_not_disturb_iteration() -> None:
    fleet = Fleet()
    for name in ("b", "d"):
        fleet.apply(Appeared(name, 1), 0)
    fleet.show_awaited(DESCRIPTION_WAIT_NS)
    seen = []
    for name in fleet.robots:
        seen.append(name)
        fleet.apply(Appeared("a", 1), 0)
        fleet.apply(Appeared("c", 1), 0)
        fleet.show_awaited(DESCRIPTION_WAIT_NS)
    assert (seen, list(fleet.robots)) == (["b", "d"], ["a", "b", "c", "d"])


def test_robots_of_one_urdf_share_its_model_as_long_as_one_of_them_has_it() -> None:
    fleet = Fleet()
    for name in ("r", "s"):
        fleet.apply(Appeared(name, 5), 1)
        fleet.apply(Described(said(robot=name)), 1)
    robots = fleet.robots
    assert robots["r"].model is not None and robots["r"].model is robots["s"].model
    shared = weakref.ref(robots["r"].model)
    other = URDF.replace("upper='1'", "upper='2'")
    fleet.apply(Described(said(urdf=other)), 2)
    model = robots["r"].model
    assert model is not None and model.joints["slide"].limits.upper == 2 and shared() is robots["s"].model
    fleet.apply(Described(said(robot="s", urdf=other)), 2)
    assert robots["s"].model is model
    gc.collect()
    assert shared() is None


def test_before_the_first_frame_every_value_is_unknown() -> None:
    _, robot = fleet_after(*UP)
    assert robot.frame is robot.wall_ns is robot.sequence is None
    assert robot.positions.keys() == set(JOINTS)
    assert all(map(math.isnan, robot.positions.values()))
    assert robot.link_pose("c") is None


def test_a_frame_gives_values_and_poses() -> None:
    _, robot = fleet_after(*UP, framed(1, math.pi, 0.5))
    pose = robot.link_pose("c")
    assert pose is not None
    assert pose.position_m == pytest.approx((-1.5, 0, 1))
    assert math.isnan(robot.observe_joint("turn", "efforts", 0.01).values[0])
    assert robot.observe_joint("turn", "velocities", 0.001).values == (0.0,)
    assert robot.frame is robot.frame


def test_a_frame_that_came_before_the_description_counts_after_it() -> None:
    fleet, robot = fleet_after(Appeared("r", 5), framed(1, 0.25))
    assert robot.frame is None
    assert kinds(fleet.apply(Described(said()), 9)) == ["described", "frame"]
    assert robot.positions["turn"] == 0.25


def test_an_early_frame_that_does_not_fit_is_malformed() -> None:
    fleet, robot = fleet_after(Appeared("r", 5), framed(1))
    assert kinds(fleet.apply(Described(said(joints=("turn",), layout=layout(1, False))), 9)) == ["described"]
    assert robot.frame is None
    assert fleet.malformed_counts["r"] == 1


def test_frames_that_are_late_or_of_another_run_are_dropped() -> None:
    fleet, robot = fleet_after(*UP, framed(7))
    for late in (framed(7), framed(6), framed(8, run=4)):
        assert fleet.apply(late, 9) == []
    assert robot.sequence == 7
    assert fleet.dropped["r"] == 3
    assert not fleet.malformed_counts


@pytest.mark.parametrize(
    "event",
    [
        Framed("r", b"rubbish"),
        Framed("r", framed(2).payload[:-1]),
        framed(2, base=Base((0, 0, 0), (0, 0, 0, 1), (0, 0, 0), (0, 0, 0))),
        Framed(
            "r",
            encode_state(
                State(incarnation=5, sequence=2, monotonic_ns=0, wall_ns=0, positions=(), velocities=(), efforts=())
            ),
        ),
    ],
)
def test_frames_that_do_not_fit_are_malformed_and_harmless(event: Framed) -> None:
    fleet, robot = fleet_after(*UP, framed(1))
    assert fleet.apply(event, 9) == []
    assert fleet.malformed_counts["r"] == 1
    assert robot.sequence == 1


def test_a_frame_with_an_infinite_value_has_no_values() -> None:
    fleet, robot = fleet_after(*UP, framed(1, math.inf))
    assert robot.frame is None
    assert math.isnan(robot.positions["turn"])
    assert fleet.malformed_counts["r"] == 1


def test_a_restart_drops_measured_values_and_keeps_the_tree() -> None:
    fleet, robot = fleet_after(*UP, framed(9), Vanished("r", 5))
    assert kinds(fleet.apply(Appeared("r", 6), 9)) == ["appeared"]
    assert (robot.incarnation, robot.frame) == (6, None)
    assert robot.model is not None
    assert kinds(fleet.apply(Described(said(6)), 9)) == ["described"]
    assert kinds(fleet.apply(framed(1, run=6), 9)) == ["frame"]


def test_the_end_of_an_old_run_does_not_take_the_new_one_offline() -> None:
    for order in ((5, 6), (6, 5)):
        fleet, robot = fleet_after(*(Appeared("r", run) for run in order), Described(said(5)), Described(said(6)))
        assert robot.incarnation == 6
        assert fleet.apply(Vanished("r", 5), 9) == []
        assert robot.online


def test_when_the_newer_of_two_runs_ends_the_older_is_the_present_one() -> None:
    fleet, robot = fleet_after(Appeared("r", 5), Appeared("r", 6), Described(said(5)), Described(said(6)))
    assert kinds(fleet.apply(Vanished("r", 6), 9)) == ["appeared", "described"]
    assert (robot.incarnation, robot.description) == (5, said(5))


def test_a_newer_run_that_ends_at_once_does_not_repair_the_description_of_the_older() -> None:
    """The second of two agents that started together ends; the fault of the first remains."""
    fleet, robot = fleet_after(Appeared("r", 5), Described(said(joints=("turn", "turn"))), Appeared("r", 6))
    assert kinds(fleet.apply(Vanished("r", 6), 9)) == ["appeared", "faulty"]
    assert robot.fault is not None and "twice" in robot.fault
    assert fleet.apply(framed(1), 9) == []
    assert robot.positions == {}
    assert kinds(fleet.apply(Described(said()), 9)) == ["described", "frame"]


def test_a_run_that_returns_is_as_faulty_as_before() -> None:
    """An older run was the present one meanwhile, and said nothing."""
    unusable = Described(said(joints=("turn", "turn")))
    fleet, robot = fleet_after(Appeared("r", 4), Appeared("r", 5), unusable, Vanished("r", 5), Appeared("r", 5))
    assert fleet.apply(framed(1), 9) == []
    assert (robot.described, robot.positions) == (False, {})
    assert kinds(fleet.apply(unusable, 9)) == ["faulty"]
    assert fleet.apply(unusable, 9) == []


@pytest.mark.parametrize(
    ("changed", "reason"),
    [
        ({"urdf": "<robot"}, "no well-formed XML"),
        ({"joints": ("turn", "elbow")}, "'elbow'"),
        ({"joints": ("turn", "turn")}, "twice"),
        ({"layout": ()}, "layout"),
        ({"base": "floating"}, "layout"),
    ],
)
def test_a_description_that_contradicts_itself_makes_the_robot_faulty(changed: dict[str, object], reason: str) -> None:
    fleet, robot = fleet_after(Appeared("r", 5))
    assert kinds(fleet.apply(Described(said(**changed)), 9)) == ["faulty"]
    assert robot.fault is not None
    assert reason in robot.fault
    assert fleet.apply(framed(1), 9) == []
    assert robot.frame is None
    assert kinds(fleet.apply(Described(said()), 9)) == ["described", "frame"]
    assert robot.fault is None


def test_a_robot_that_cannot_be_understood_is_visible_with_the_reason() -> None:
    fleet, robot = fleet_after(Appeared("r", 5))
    assert kinds(fleet.apply(DescriptionRejected("r", 5, "wire version 9"), 9)) == ["faulty"]
    assert fleet.apply(DescriptionRejected("r", 5, "wire version 9"), 9) == []
    assert (robot.online, robot.fault, robot.description, robot.model) == (True, "wire version 9", None, None)


def test_link_poses_are_of_the_present_frame() -> None:
    fleet, robot = fleet_after(*UP, framed(1, slide=0.5))
    for slide in (0.5, 0.75):
        fleet.apply(framed(2 + int(slide * 4), slide=slide), 9)
        pose = robot.link_pose("c")
        assert pose is not None
        assert pose.position_m == pytest.approx((1 + slide, 0, 1))
    assert (robot.link_pose("z"), robot.fault) == (None, None)


def test_a_value_changes_when_it_moves_by_the_resolution() -> None:
    fleet, robot = fleet_after(*UP, framed(1))
    assert robot.observe("x", (0.1234, math.nan), 0.01) == Observation(
        (0.12, pytest.approx(math.nan, nan_ok=True)), 1001, 1
    )
    fleet.apply(framed(2), 9)
    held = robot.observe("x", (0.1299, math.nan), 0.01)
    assert (held.values[0], held.wall_ns) == (0.12, 1001)
    assert robot.observe("x", (0.13, math.nan), 0.01).wall_ns == 1002
    assert robot.observe("x", (0.13, 0.0), 0.01).values == (0.13, 0.0)


def test_a_restart_resets_observations() -> None:
    fleet, robot = fleet_after(*UP, framed(1))
    robot.observe("x", (1.0,), 0.1)
    fleet.apply(Appeared("r", 6), 9)
    assert robot.observe("x", (1.04,), 0.1) == Observation((1.0,), None)


@pytest.mark.parametrize(
    ("value", "resolution", "expected"),
    [(0.1 + 0.2, 1e-9, 0.3), (1.23456, 0.005, 1.235), (-1e-9, 1e-3, 0.0), (1e300, 1e-6, 1e300), (17.0, 10.0, 20.0)],
)
def test_values_are_rounded_to_decimals_that_print_short(value: float, resolution: float, expected: float) -> None:
    assert repr(rounded(value, resolution)) == repr(expected)


def test_undescribed_robots_are_shown_up_to_a_limit() -> None:
    fleet = Fleet()
    changes = [change for number in range(10_000) for change in fleet.apply(Appeared(f"flood{number}", 5), 1)]
    assert len(changes) == len(fleet.show_awaited(2 * DESCRIPTION_WAIT_NS)) == len(fleet.robots) == MAX_UNDESCRIBED
    for number in range(10_000):
        fleet.apply(DescriptionRejected(f"flood{number}", 5, "it is silent"), 2)
    assert len(fleet.robots) == MAX_UNDESCRIBED
    assert fleet.malformed_counts.total() == 10_000


def test_a_robot_that_describes_itself_is_shown_however_many_do_not() -> None:
    fleet = Fleet()
    for number in range(1000):
        fleet.apply(Appeared(f"flood{number}", 5), 1)
    assert fleet.apply(Appeared("r", 4), 2) == fleet.apply(Appeared("r", 5), 2) == []
    assert kinds(fleet.apply(Described(said()), 3)) == ["appeared", "described"]
    assert kinds(fleet.apply(framed(1, 0.25), 4)) == ["frame"]
    robot = fleet.robots["r"]
    assert (robot.online, robot.positions["turn"]) == (True, 0.25)
    assert kinds(fleet.apply(Vanished("r", 5), 5)) == ["appeared"]
    assert robot.incarnation == 4


def test_a_robot_that_never_described_itself_is_forgotten_with_its_token() -> None:
    fleet = Fleet()
    for number in range(100):
        fleet.apply(Appeared(f"flood{number}", 5), 1)
        fleet.apply(DescriptionRejected(f"flood{number}", 5, "it is silent"), 1)
    for number in range(100):
        fleet.apply(Vanished(f"flood{number}", 5), 2)
    assert (len(fleet.robots), dict(fleet.malformed_counts)) == (0, {"(others)": MAX_UNDESCRIBED, "(undescribed)": 36})
    assert kinds(fleet.apply(Appeared("r", 5), 3)) == ["appeared"]


def test_descriptions_that_cannot_be_used_make_no_more_robots_visible_than_silence() -> None:
    fleet = Fleet()
    for number in range(200):
        fleet.apply(Appeared(f"flood{number}", 5), 1)
        fleet.apply(Described(said(robot=f"flood{number}", urdf="<robot")), 1)
    assert len(fleet.robots) == MAX_UNDESCRIBED
    for number in range(200):
        fleet.apply(Vanished(f"flood{number}", 5), 2)
    assert len(fleet.robots) == 0


def test_a_robot_that_described_itself_once_stays_readable() -> None:
    fleet, robot = fleet_after(
        *UP, Vanished("r", 5), Appeared("r", 6), DescriptionRejected("r", 6, "?"), Vanished("r", 6)
    )
    assert (fleet.robots["r"], robot.online) == (robot, False)


def test_in_a_full_fleet_the_robot_that_has_been_offline_longest_makes_room(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("linked_fleet_state.fleet.MAX_ROBOTS", 3)
    fleet = Fleet()
    for now, name in enumerate(("a", "b", "c")):
        fleet.apply(Appeared(name, 5), now)
        fleet.apply(Described(said(robot=name)), now)
    assert fleet.apply(Appeared("d", 5), 9) == []
    fleet.apply(Vanished("c", 5), 9)
    fleet.apply(Vanished("b", 5), 9)
    assert fleet.apply(Appeared("d", 5), 9) == [Change("b", "vanished"), Change("d", "appeared")]
    assert list(fleet.robots) == ["a", "c"]
    fleet.apply(Described(said(robot="d")), 9)
    assert list(fleet.robots) == ["a", "c", "d"]
