"""Which commands are accepted, and what is said of the others."""

import math

import pytest

from agents.robot import JointFacts, Limits
from agents.safety import Remembered, clamp, judge
from agents.wire.messages import WIRE_VERSION, Accepted, Command, Move, Refused

NOW = 10_000_000_000
JOINTS = {
    joint.name: joint
    for joint in (
        JointFacts("arm", limits=Limits(-1.0, 2.0, 1.0, 5.0)),
        JointFacts("wheel"),
        JointFacts("finger", linear=True, limits=Limits(0.0, 0.04), mimics="thumb"),
    )
}


def _command(targets: dict[str, float], seen_ns: int = NOW, incarnation: int = 7, command_id: str = "new") -> Command:
    return Command(
        version=WIRE_VERSION,
        id=command_id,
        incarnation=incarnation,
        seen_ns=seen_ns,
        time_to_live_ns=1_000,
        motion=Move(targets),
    )


@pytest.mark.parametrize(
    ("command", "code", "says"),
    [
        (_command({"arm": 2.0, "wheel": 1e6}), None, ""),
        (_command({"arm": 0.0}, seen_ns=NOW - 1_000), None, ""),
        (_command({"arm": 2.0 + 1e-9}), None, ""),
        (_command({"arm": 0.0}, seen_ns=NOW - 1_001), "stale", "time to live"),
        (_command({"arm": 0.0}, seen_ns=NOW + 1), "stale", "ahead"),
        (_command({"arm": 0.0}, incarnation=8), "incarnation", "run 7"),
        (_command({"arm": 0.0}, command_id="old"), "repeated", "old"),
        (_command({"leg": 0.0}), "unknown-joint", "arm, wheel"),
        (_command({"finger": 0.0}), "unknown-joint", "thumb"),
        (_command({"arm": 2.1}), "limits", "upper limit 2 rad"),
        (_command({"wheel": 0.0, "arm": -1.1}), "limits", "lower limit -1 rad"),
        (_command({"wheel": math.nan}), "limits", "finite"),
        (_command({"wheel": math.inf}), "limits", "finite"),
    ],
)
def test_judge(command: Command, code: str | None, says: str) -> None:
    """The first thing that is wrong is named, with what would have been right."""
    reply = judge(command, now_ns=NOW, incarnation=7, joints=JOINTS, seen={"old"})
    if code is None:
        assert reply == Accepted(command.id)
    else:
        assert isinstance(reply, Refused)
        assert (reply.code, says in reply.reason) == (code, True), reply.reason


def test_rounding_is_clamped() -> None:
    """What the tolerance lets through still ends at the limit."""
    assert clamp({"arm": 2.0 + 1e-9, "wheel": 9.0}, JOINTS) == {"arm": 2.0, "wheel": 9.0}


def test_memory_of_ids_is_bounded() -> None:
    """The oldest id is forgotten first."""
    seen = Remembered(capacity=2)
    for command_id in ("a", "b", "c"):
        seen.add(command_id)
    assert [command_id in seen for command_id in ("a", "b", "c")] == [False, True, True]
    assert len(seen) == 2
