"""Which commands are accepted, and the reasons of refusals."""

import math

import pytest

from linked_fleet_agent.robot import JointFacts, Limits
from linked_fleet_agent.safety import ROUNDING, RecentIds, Stops, check_command, check_stop, clamp, position_mismatch
from linked_fleet_agent.wire.messages import WIRE_VERSION, Accepted, Command, Expectation, Follow, Move, Refused, Stop

NOW = 10_000_000_000
JOINTS = {
    joint.name: joint
    for joint in (
        JointFacts("arm", limits=Limits(-1.0, 2.0, 1.0, 5.0)),
        JointFacts("wheel", continuous=True),
        JointFacts("finger", linear=True, limits=Limits(0.0, 0.04), mimics="thumb"),
        JointFacts("caster", continuous=True, passive=True),
    )
}


def _command(
    motion: dict[str, float] | Move | Follow,
    seen_ns: int = NOW,
    incarnation: int = 7,
    command_id: str = "new",
    expects: tuple[str, ...] = (),
) -> Command:
    return Command(
        version=WIRE_VERSION,
        id=command_id,
        incarnation=incarnation,
        seen_ns=seen_ns,
        time_to_live_ns=1_000,
        motion=Move(motion) if isinstance(motion, dict) else motion,
        expects=dict.fromkeys(expects, Expectation(0.0, 0.1)),
    )


def _follow(
    *rows: tuple[float, ...],
    joints: tuple[str, ...] = ("arm", "wheel"),
    times_s: tuple[float, ...] | None = None,
    incarnation: int = 7,
    seen_ns: int = NOW,
) -> Command:
    times_s = tuple(range(1, len(rows) + 1)) if times_s is None else times_s
    return _command(Follow(joints, times_s, rows), seen_ns, incarnation)


@pytest.mark.parametrize(
    ("command", "code", "says"),
    [
        (_command({"arm": 2.0, "wheel": 1e6}), None, ""),
        (_command({"wheel": 0.0}, seen_ns=NOW - 1_000), None, ""),
        (_command({"arm": 2.0 + ROUNDING}), None, ""),
        (_command({"arm": -1.0 - ROUNDING}), None, ""),
        (_command({"arm": 0.0}, seen_ns=NOW - 1_001), "stale", "is 0 ms old, its time to live 0.001 ms"),
        (_command({"arm": 0.0}, seen_ns=NOW - 10**9), "stale", "is 1000 ms old"),
        (_command({"arm": 0.0}, seen_ns=NOW + 1), "stale", "is 1 ns ahead"),
        (_command({"wheel": 0.0, "arm": 0.0}, seen_ns=NOW - 500), "stale", "stopped after the command was requested"),
        (_command({"arm": 0.0}, seen_ns=NOW - 499), None, ""),
        (_command({"wheel": 0.0}, seen_ns=NOW - 500), None, ""),
        (_command({"wheel": 0.0}, seen_ns=NOW - 500, expects=("arm",)), None, ""),
        (_follow((0.0, 0.0), seen_ns=NOW - 500), "stale", "'arm'"),
        (_command({"wheel": 0.0}, command_id="cancelled"), "stale", "cancelled before it arrived"),
        (_command({"arm": 0.0}, incarnation=8), "incarnation", "run 7"),
        (_command({"arm": 0.0}, command_id="old"), "repeated", "old"),
        (
            _command({"leg": 0.0}),
            "unknown-joint",
            "'leg' is not a movable joint of this robot; its joints are arm, wheel",
        ),
        (_command({"finger": 0.0}), "unknown-joint", "thumb"),
        (_command({"caster": 0.0}), "unknown-joint", "no actuator"),
        (_command({"arm": 2.1}), "limits", "upper limit 2 rad"),
        (_command({"wheel": 0.0, "arm": -1.1}), "limits", "lower limit -1 rad"),
        (_command({"arm": 2.0 + 2 * ROUNDING}), "limits", "upper limit"),
        (_command({"arm": -1.0 - 2 * ROUNDING}), "limits", "lower limit"),
        (_command({"wheel": math.nan}), "limits", "finite"),
        (_command({"wheel": math.inf}), "limits", "finite"),
        (_command({"wheel": 1e6 + 0.5}), "limits", "from zero"),
        (_command({"wheel": -1e6 - 0.5}), "limits", "from zero"),
        (_command(Move({"arm": 0.0}, {"arm": 0.1})), None, ""),
        (_command(Move({"arm": 0.0}, {"wheel": 0.1})), "malformed", "'wheel' has a speed, but no target"),
        (_command({"arm": 0.0}, expects=("wheel", "finger")), None, ""),
        (_command({"arm": 0.0}, expects=("leg",)), "unknown-joint", "arm, wheel"),
        (_follow((0.0, 9.0), (2.0, -9.0)), None, ""),
        (_follow((0.0, 0.0), joints=("arm", "arm")), "malformed", "twice"),
        (_follow((0.0, 0.0), (0.0,)), "malformed", "2 joints"),
        (_follow((), joints=("arm",)), "malformed", "1 joints"),
        (_follow((0.0, 0.0), times_s=(1.0, 2.0)), "malformed", "1 rows of positions, but 2 times"),
        (_follow((0.0, 0.0), (0.0, 0.0), times_s=(1.0, 1.0)), "malformed", "times_s"),
        (_follow((0.0, 0.0), times_s=(1e-9,)), "malformed", "times_s"),
        (_follow((0.0, 0.0), (0.0, 0.0), times_s=(0.001, 0.002)), None, ""),
        (_follow((0.0, 0.0), (0.0, 0.0), times_s=(0.001, 0.0019)), "malformed", "times_s"),
        (_follow(*[(0.0, 0.0)] * 8_192), None, ""),
        (_follow(*[(0.0, 0.0)] * 8_193), "malformed", "16386 positions are too many; 16384 may be"),
        (_follow((0.0, 0.0), joints=("arm", "leg")), "unknown-joint", "arm, wheel"),
        (_follow((0.0, 0.0), joints=("arm", "finger")), "unknown-joint", "thumb"),
        (_follow((0.0, 0.0), (2.1, 0.0)), "limits", "upper limit 2 rad"),
        (_follow((0.0, 0.0), (0.0, math.nan), (0.0, 0.0)), "limits", "finite"),
        (_follow((0.0, 0.0), (0.0,), incarnation=8), "malformed", "2 joints"),
    ],
)
def test_judge(command: Command, code: str | None, says: str) -> None:
    """The first fault is named, with what would have been right."""
    stops = Stops()
    stops.record(["arm"], NOW - 500)
    stops.cancel("cancelled")
    reply = check_command(command, now_ns=NOW, incarnation=7, joints=JOINTS, seen={"old"}, stops=stops)
    if code is None:
        assert reply == Accepted(command.id, at_ns=NOW)
    else:
        assert isinstance(reply, Refused)
        assert (reply.id, reply.code, says in reply.reason) == (command.id, code, True), reply.reason


def test_a_command_of_the_first_instant_is_not_taken_for_stopped() -> None:
    """The monotonic clock of an agent may begin at 0."""
    command = _command({"wheel": 0.0}, seen_ns=0)
    assert check_command(command, now_ns=1, incarnation=7, joints=JOINTS, seen=(), stops=Stops()) == Accepted(
        "new", at_ns=1
    )


def test_a_reason_is_at_most_1024_characters_long() -> None:
    """Reasons may name all joints of a robot with many."""
    joints = {name: JointFacts(name) for name in (f"joint_{number}" for number in range(200))}
    reply = check_command(_command({"leg": 0.0}), now_ns=NOW, incarnation=7, joints=joints, seen=(), stops=Stops())
    refused = check_stop(Stop(version=WIRE_VERSION, id="s", joints=("leg",)), joints)
    for each in (reply, refused):
        assert isinstance(each, Refused)
        assert each.reason.startswith("'leg' is not a movable joint") and len(each.reason) == 1024


def test_rounding_is_clamped() -> None:
    """A value beyond a limit but within the tolerance still ends at the limit."""
    assert clamp(Move({"arm": 2.0 + 1e-9, "wheel": 9.0}, {"arm": 1.0}), JOINTS) == Move(
        {"arm": 2.0, "wheel": 9.0}, {"arm": 1.0}
    )
    follow = Follow(("wheel", "arm"), (1.0, 2.0), ((9.0, -1.0 - 1e-9), (0.0, 2.0 + 1e-9)))
    assert clamp(follow, JOINTS) == Follow(("wheel", "arm"), (1.0, 2.0), ((9.0, -1.0), (0.0, 2.0)))


@pytest.mark.parametrize(
    ("joint", "measured", "says"),
    [
        ("arm", 1.05, ""),
        ("arm", 1.2, "'arm' was expected at 1 rad, give or take 0.1 rad, but is at 1.2 rad"),
        ("arm", 1.0 + 2 * math.pi, "expected"),
        ("arm", math.nan, "expected"),
        ("wheel", 1.05 - 20 * math.pi, ""),
        ("wheel", 0.95 + 2 * math.pi, ""),
        ("wheel", 1.0 + math.pi, "expected"),
        ("wheel", math.nan, "expected"),
        ("finger", 1.2, "give or take 0.1 m"),
    ],
)
def test_expected_positions_are_compared_within_the_tolerance(joint: str, measured: float, says: str) -> None:
    """A continuous joint may be a whole turn away; an unknown position never matches."""
    found = position_mismatch({joint: Expectation(1.0, 0.1)}, {joint: measured}, JOINTS)
    assert (says in found, bool(found)) == (True, bool(says)), found


def test_a_position_at_the_end_of_the_tolerance_is_as_expected() -> None:
    assert position_mismatch({"arm": Expectation(1.0, 0.5)}, {"arm": 1.5}, JOINTS) == ""


def test_a_stop_is_refused_only_for_unknown_joints() -> None:
    """Joints that mimic others can be stopped as well."""
    assert check_stop(Stop(version=WIRE_VERSION, id="s", joints=("arm", "finger")), JOINTS) is None
    assert check_stop(Stop(version=WIRE_VERSION, id="s", command="whatever"), JOINTS) is None
    refused = check_stop(Stop(version=WIRE_VERSION, id="s", joints=("arm", "leg")), JOINTS)
    assert refused is not None
    assert (refused.id, refused.code) == ("s", "unknown-joint")


def test_memory_of_ids_is_bounded() -> None:
    """The oldest id is forgotten first."""
    seen = RecentIds(capacity=2)
    for command_id in ("a", "b", "c"):
        seen.add(command_id)
    assert [command_id in seen for command_id in ("a", "b", "c")] == [False, True, True]
    assert len(seen) == 2


def test_the_last_4096_ids_are_known() -> None:
    """The number is that of agents/linked_fleet_agent/wire/PROTOCOL.md."""
    seen = RecentIds()
    for number in range(4_097):
        seen.add(str(number))
    assert ("0" in seen, "1" in seen, len(seen)) == (False, True, 4_096)
