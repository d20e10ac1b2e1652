"""What a path is between its waypoints, and which motions are refused."""

import itertools

import pytest
from hypothesis import given
from hypothesis import strategies as st

from agents.plan import ImpossibleError, Start, joints_of, plan
from agents.profile import cruise_of
from agents.robot import JointFacts, Limits
from agents.wire.messages import Follow, Move

ARM = JointFacts("arm", limits=Limits(-3.0, 3.0, 1.0, 5.0))
JOINTS = {"arm": ARM, "wheel": JointFacts("wheel", continuous=True), "lift": JointFacts("lift", linear=True)}


@given(st.lists(st.tuples(st.floats(0.05, 3.0), st.floats(-3, 3)), min_size=1, max_size=8), st.floats(-3, 3))
def test_a_path_goes_through_its_waypoints_or_is_refused(rows: list[tuple[float, float]], start: float) -> None:
    """It is at each waypoint in time, stays between two of them, and the factor in a refusal is one that suffices."""
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
            assert abs(velocity) <= path.fastest + 1e-9 <= cruise_of(ARM) * (1 + 1e-5)
        assert path.at(end)[0] == pytest.approx(after, abs=1e-9)


@pytest.mark.parametrize(
    ("motion", "says"),
    [
        (Follow(("arm",), (1.0,), ((1.0,),)), "arm would need 1.5 rad/s, and 0.4 rad/s are allowed; .* 3.750$"),
        (Follow(("arm", "lift"), (4.0,), ((0.1, 1.0),)), "lift would need 0.375 m/s"),
        (Move({"arm": 1.0}, {"arm": 1e-7}), "too slow"),
        (Move({"arm": 1.0}, {"arm": 1e-5}), "86400 s are the most"),
        (Move({"wheel": 1e6}), "86400 s are the most"),
        (Move({"arm": 1.0}, {"arm": 5e-324}), "too slow"),
    ],
)
def test_what_is_too_fast_or_too_slow_is_refused_with_what_would_do(motion: Move | Follow, says: str) -> None:
    with pytest.raises(ImpossibleError, match=says):
        plan(motion, 0.5, [Start(JOINTS[name], 0.0) for name in joints_of(motion)])
