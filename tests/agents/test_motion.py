"""How setpoints move, against a joint that follows perfectly, one that is stuck, and one that is taken over."""

import itertools
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from agents.motion import SETTLE_S, Motions, Outcome, Sway, cruise_of
from agents.robot import JointFacts, Limits

ARM = JointFacts("arm", limits=Limits(-3.0, 3.0, 1.0, 5.0))
JOINTS = {"arm": ARM, "wheel": JointFacts("wheel")}
DT = 0.01


def _follow(
    motions: Motions, measured: dict[str, float], steps: int, stuck: bool = False
) -> tuple[list[float], list[Outcome]]:
    """Step with joints that are at their setpoints at once (or never): the path of ``arm`` and what ended."""
    path, ended = [], []
    for _ in range(steps):
        setpoints, outcomes = motions.step(DT, measured, {"arm": 5.0 if stuck else 0.0})
        measured |= {} if stuck else setpoints
        path.append(measured["arm"])
        ended += outcomes
    return path, ended


@given(st.floats(-3, 3), st.lists(st.tuples(st.floats(-3, 3), st.integers(1, 400)), min_size=1, max_size=5))
def test_no_setpoint_is_ever_faster_than_the_cruise_or_beyond_a_limit(
    start: float, goals: list[tuple[float, int]]
) -> None:
    """However often it is redirected; and the last goal is reached exactly."""
    motions, measured = Motions(JOINTS), {"arm": start, "wheel": 0.0}
    path = [start]
    for number, (goal, steps) in enumerate(goals):
        motions.start(str(number), {"arm": goal}, measured)
        path += _follow(motions, measured, steps)[0]
    path += _follow(motions, measured, 2_000)[0]
    assert max(abs(b - a) / DT for a, b in itertools.pairwise(path)) <= cruise_of(ARM) * (1 + 1e-6)
    assert all(-3.0 <= position <= 3.0 for position in path)
    assert path[-1] == goals[-1][0]


def test_a_motion_runs_and_succeeds() -> None:
    """One running, one succeeded."""
    motions, measured = Motions(JOINTS), {"arm": 0.0, "wheel": 0.0}
    assert [outcome.state for outcome in motions.start("a", {"arm": 1.0}, measured)] == ["running"]
    assert [(o.command_id, o.state) for o in _follow(motions, measured, 500)[1]] == [("a", "succeeded")]


def test_a_newer_motion_preempts_the_whole_older_one() -> None:
    """The older command ends once, and its other joint comes to rest short of its target."""
    motions, measured = Motions(JOINTS), {"arm": 0.0, "wheel": 0.0}
    motions.start("a", {"arm": 1.0, "wheel": 5.0}, measured)
    _follow(motions, measured, 50)
    outcomes = motions.start("b", {"arm": -1.0}, measured)
    assert [(o.command_id, o.state) for o in outcomes] == [("a", "preempted"), ("b", "running")]
    assert [(o.command_id, o.state) for o in _follow(motions, measured, 1_000)[1]] == [("b", "succeeded")]
    assert measured["wheel"] < 1.0


@pytest.mark.parametrize("target", [0.1, 2.0])
def test_a_stuck_joint_fails_and_is_no_longer_pushed(target: float) -> None:
    """The reason names the joint and its effort limit; the setpoint returns to where the joint is."""
    motions, measured = Motions(JOINTS), {"arm": 0.0, "wheel": 0.0}
    motions.start("a", {"arm": target}, measured)
    _, [outcome] = _follow(motions, measured, round((SETTLE_S + 3.0) / DT), stuck=True)
    assert (outcome.state, "arm is at its effort limit" in outcome.reason) == ("failed", True)
    motions.start("b", {"wheel": 0.1}, measured)
    assert motions.step(DT, measured, {})[0].get("arm", 0.0) == 0.0


def test_a_halt_brakes_and_fails_what_runs() -> None:
    """No jump: the joint rolls out within its ramp and then keeps still."""
    motions, measured = Motions(JOINTS), {"arm": 0.0, "wheel": 0.0}
    motions.start("a", {"arm": 2.0}, measured)
    _follow(motions, measured, 60)
    assert motions.halt("gateway lost") == [Outcome("a", "failed", ("arm",), "gateway lost")]
    path, ended = _follow(motions, measured, 200)
    assert not ended
    assert path[-1] == path[-2] < 1.0


def test_a_command_takes_a_swaying_joint_over_for_good() -> None:
    """It sways, pauses while held, and after a command stays where the command put it."""
    motions, measured = Motions(JOINTS, [Sway("arm", 0.4, 2.0)]), {"arm": 0.0, "wheel": 0.0}
    path, _ = _follow(motions, measured, 400)
    assert max(path) > 0.2
    assert min(path) < -0.2
    motions.start("a", {"arm": 0.5}, measured)
    path, _ = _follow(motions, measured, 600)
    assert path[-1] == path[-100] == 0.5


def test_an_unknown_position_never_succeeds() -> None:
    """NaN is not within any tolerance."""
    motions = Motions(JOINTS)
    motions.start("a", {"arm": 0.0}, {"arm": 0.0, "wheel": 0.0})
    _, outcomes = motions.step(DT, {"arm": math.nan, "wheel": math.nan}, {})
    assert [outcome.state for outcome in outcomes] == ["failed"]
