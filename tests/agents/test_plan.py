"""Paths between waypoints, and the motions that are refused."""

import itertools

import pytest
from hypothesis import given
from hypothesis import strategies as st

from linked_fleet_agent.plan import ImpossibleError, Start, joints_of, plan
from linked_fleet_agent.robot import JointFacts, Limits
from linked_fleet_agent.urdf.cruise import RAMP_S, cruise_of
from linked_fleet_agent.wire.messages import Follow, Move

ARM = JointFacts("arm", limits=Limits(-3.0, 3.0, 1.0, 5.0))
JOINTS = {"arm": ARM, "wheel": JointFacts("wheel", continuous=True), "lift": JointFacts("lift", linear=True)}


@given(st.lists(st.tuples(st.floats(0.05, 3.0), st.floats(-3, 3)), min_size=1, max_size=8), st.floats(-3, 3))
def test_a_path_goes_through_its_waypoints_or_is_refused(rows: list[tuple[float, float]], start: float) -> None:
    """It is at each waypoint in time, stays between neighbours, and the factor in a refusal suffices."""
    times = list(itertools.accumulate(row[0] for row in rows))
    positions = [row[1] for row in rows]
    starts = [Start(ARM, start)]
    try:
        made = plan(Follow(("arm",), tuple(times), tuple((at,) for at in positions)), 1.0, starts)
    except ImpossibleError as refusal:
        factor = float(str(refusal).rsplit(" ", 1)[1])
        times = [time_s * factor for time_s in times]
        made = plan(Follow(("arm",), tuple(times), tuple((at,) for at in positions)), 1.0, starts)
    path = made.trajectories["arm"]
    assert path.at(0.0)[1] == path.at(times[-1])[1] == 0.0
    for before, after, begin, end in zip([start, *positions[:-1]], positions, [0.0, *times[:-1]], times, strict=True):
        for step in range(21):
            position, velocity = path.at(begin + (end - begin) * step / 20)
            assert min(before, after) - 1e-9 <= position <= max(before, after) + 1e-9
            assert abs(velocity) <= path.maximum_speed + 1e-9 <= cruise_of(ARM) * (1 + 1e-5)
        assert path.at(end)[0] == pytest.approx(after, abs=1e-9)


_rows = st.lists(st.tuples(st.floats(0.001, 400.0), st.floats(-2, 2)), min_size=1, max_size=5)


@given(_rows, st.sampled_from(["arm", "wheel", "lift"]), st.floats(-2, 2), st.floats(-1, 1))
def test_a_joint_that_moves_swings_no_further_than_it_takes_to_brake(
    rows: list[tuple[float, float]], name: str, at: float, share: float
) -> None:
    """It never jumps, keeps its speed at first, is in time, and overshoots waypoints by its braking distance at
    most.
    """
    joint, times = JOINTS[name], list(itertools.accumulate(row[0] for row in rows))
    velocity = share * cruise_of(joint)
    follow = Follow((name,), tuple(times), tuple((row[1],) for row in rows))
    try:
        path = plan(follow, 1.0, [Start(joint, at, velocity)]).trajectories[name]
    except ImpossibleError as refusal:
        assert "stretch all times" in str(refusal)
        return
    braking, places = velocity**2 * RAMP_S / (2.0 * cruise_of(joint)), [at, *(row[1] for row in rows)]
    assert min(places) - braking - 1e-6 <= path.extremes[0] <= path.extremes[1] <= max(places) + braking + 1e-6
    assert path.at(0.0) == (at, pytest.approx(velocity, abs=1e-5))
    ends = [segment.start_s for segment in path.segments[1:]]
    for before, begin, end in zip(path.segments, [0.0, *ends], ends, strict=False):
        assert before.at(end - begin) == pytest.approx(path.at(end), abs=1e-5)
    for time_s, row in zip(times, rows, strict=True):
        assert path.at(time_s)[0] == pytest.approx(row[1], abs=1e-5)
    assert path.maximum_speed <= cruise_of(joint) * (1 + 1e-5)


def test_a_joint_that_would_swing_far_brakes_first() -> None:
    """At full speed, with half a minute until the waypoint, there is time to stop, so nothing is refused."""
    for name, speed in (("arm", 0.8), ("wheel", -0.5), ("lift", 0.05)):
        follow = Follow((name,), (30.0,), ((0.01,),))
        path = plan(follow, 1.0, [Start(JOINTS[name], 0.0, speed)]).trajectories[name]
        assert path.at(RAMP_S) == pytest.approx((speed * RAMP_S / 2.0, 0.0), abs=1e-9)
        assert path.at(30.0) == (0.01, 0.0)


def test_a_trajectory_from_an_excessive_velocity_is_refused() -> None:
    """Scaling the times would not help."""
    with pytest.raises(
        ImpossibleError, match=r"still moving at 0\.7 rad/s, and 0\.4 rad/s are allowed; stop it first$"
    ):
        plan(Follow(("arm",), (100.0,), ((1.0,),)), 0.5, [Start(ARM, 0.0, -0.7)])


@pytest.mark.parametrize(
    ("motion", "says"),
    [
        (Follow(("arm",), (1.0,), ((1.0,),)), "arm would need 1.5 rad/s, and 0.4 rad/s are allowed; .* 3.750$"),
        (Follow(("arm", "lift"), (4.0,), ((0.1, 1.0),)), "lift would need 0.375 m/s"),
        (Move({"arm": 1.0}, {"arm": 1e-7}), "too slow"),
        (Move({"arm": 1.0}, {"arm": 1e-5}), "86400 s is the maximum"),
        (Move({"wheel": 1e6}), "86400 s is the maximum"),
        (Move({"arm": 1.0}, {"arm": 5e-324}), "too slow"),
    ],
)
def test_a_trajectory_with_wrong_timing_is_refused_with_a_valid_one(motion: Move | Follow, says: str) -> None:
    with pytest.raises(ImpossibleError, match=says):
        plan(motion, 0.5, [Start(JOINTS[name], 0.0) for name in joints_of(motion)])
