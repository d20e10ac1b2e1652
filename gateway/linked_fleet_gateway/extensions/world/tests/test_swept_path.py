"""Paths as the agent executes them, obtained here from the agent's own code."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from linked_fleet_agent.trajectory import through_waypoints
from linked_fleet_agent.wire.messages import Follow, Move
from linked_fleet_gateway.extensions.world.questions import MOST_CONFIGURATIONS, paths_of, sampled_configurations
from linked_fleet_gateway.extensions.world.segments import interpolate

values = st.floats(-3, 3)


@given(st.lists(st.tuples(st.floats(0.1, 2), values), min_size=1, max_size=6), values, st.floats(0, 1))
def test_a_trajectory_is_the_cubics_of_the_agent(points: list[tuple[float, float]], start: float, share: float) -> None:
    times = [sum(step for step, _ in points[: i + 1]) for i in range(len(points))]
    (way,) = paths_of(Follow(("a",), tuple(times), tuple((p,) for _, p in points)), {"a": start}, {})
    agents = through_waypoints(start, 0.0, times, [p for _, p in points])
    before, begun = start, 0.0
    for leg, time in zip(way.legs, times, strict=True):
        now = interpolate(leg, "a", before, share)
        assert now == pytest.approx(agents.at(begun + share * (time - begun))[0], abs=1e-6)
        before, begun = leg.ends["a"], time


def test_joints_that_go_elsewhere_meanwhile_are_here_there_and_on_the_way() -> None:
    plain, there, along = paths_of(Move({"a": 1.0}), {"a": 0.0, "b": 0.0}, {"a": 5.0, "b": 2.0})
    assert (plain.start, plain.legs[-1].ends) == ({"a": 0.0, "b": 0.0}, {"a": 1.0})
    assert (there.start, there.legs[-1].ends) == ({"a": 0.0, "b": 2.0}, {"a": 1.0})
    assert (along.start, along.legs[-1].ends) == ({"a": 0.0, "b": 0.0}, {"a": 1.0, "b": 2.0})


def test_a_standing_robot_has_one_stance_and_a_moving_one_several() -> None:
    assert sampled_configurations({"a": 0.0}, {}) == ({"a": 0.0},)
    assert sampled_configurations({"a": 0.0}, {"a": 0.1})[1:] == ({"a": 0.05}, {"a": 0.1})
    many = sampled_configurations({"a": 0.0, "b": 1.0}, {"a": 30.0})
    assert len(many) == MOST_CONFIGURATIONS + 1 and many[-1] == {"a": 30.0}
