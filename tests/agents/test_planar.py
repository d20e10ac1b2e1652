"""Motion in the plane: arcs, limits of velocity and acceleration, and the wheels of a differential drive."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from linked_fleet_agent.planar import STANDING, Differential, DriveLimits, Pose, Ramp, Velocity

LIMITS = DriveLimits(linear=1.0, angular=2.0, linear_acceleration=0.5, angular_acceleration=3.0)
HOLONOMIC = DriveLimits(linear=1.0, angular=2.0, linear_acceleration=0.5, angular_acceleration=3.0, lateral=0.4)
NUMBERS = st.floats(-5, 5)
VELOCITIES = st.builds(Velocity, NUMBERS, NUMBERS, NUMBERS)


@given(linear=NUMBERS, lateral=NUMBERS, angular=NUMBERS, heading=NUMBERS)
def test_a_piece_is_the_sum_of_many_short_ones(linear: float, lateral: float, angular: float, heading: float) -> None:
    pieces, start = 200, Pose(1.0, -2.0, heading)
    short = start
    for _ in range(pieces):
        short = short.moved(linear / pieces, angular / pieces, lateral / pieces)
    whole = start.moved(linear, angular, lateral)
    assert whole[:2] == pytest.approx(short[:2], abs=1e-6)
    assert math.cos(whole.heading - short.heading) == pytest.approx(1.0, abs=1e-9)


def test_a_half_circle() -> None:
    assert Pose().moved(math.pi, math.pi)[:2] == pytest.approx((0.0, 2.0))


@given(wanted=VELOCITIES)
def test_what_is_requested_is_cut_to_the_limits_on_the_same_arc(wanted: Velocity) -> None:
    for limits in (LIMITS, HOLONOMIC):
        cut = limits.clamp(wanted)
        assert abs(cut.linear) <= limits.linear + 1e-12
        assert abs(cut.lateral) <= limits.lateral + 1e-12
        assert abs(cut.angular) <= limits.angular + 1e-12
        assert cut.linear * wanted.angular == pytest.approx(cut.angular * wanted.linear, abs=1e-9)


@pytest.mark.parametrize("wrong", [Velocity(math.nan), Velocity(0, math.inf), Velocity(0, 0, -math.inf)])
def test_what_is_not_finite_is_refused(wrong: Velocity) -> None:
    with pytest.raises(ValueError, match="velocities of a base are finite"):
        Ramp(LIMITS).request(wrong, 1.0)


@pytest.mark.parametrize("wrong", [0.0, -1.0, math.nan, math.inf])
def test_limits_that_are_not_positive_are_refused(wrong: float) -> None:
    with pytest.raises(ValueError, match="limits of a base are positive numbers"):
        DriveLimits(1.0, 1.0, wrong, 1.0)


@given(requests=st.lists(st.tuples(VELOCITIES, st.integers(1, 40)), min_size=1, max_size=6))
def test_the_velocity_never_changes_faster_than_it_may(requests: list[tuple[Velocity, int]]) -> None:
    ramp, now_s, step_s = Ramp(HOLONOMIC), 0.0, 0.01
    for wanted, steps in requests:
        ramp.request(wanted, now_s + 0.2)
        for _ in range(steps):
            before, now_s = ramp.velocity, now_s + step_s
            after = ramp.step(now_s, step_s)
            change = math.hypot(after.linear - before.linear, after.lateral - before.lateral)
            assert change <= HOLONOMIC.linear_acceleration * step_s + 1e-12
            assert abs(after.angular - before.angular) <= HOLONOMIC.angular_acceleration * step_s + 1e-12


@given(wanted=VELOCITIES)
def test_it_brakes_by_itself_on_its_arc_in_the_time_that_it_says(wanted: Velocity) -> None:
    ramp, step_s = Ramp(LIMITS), 0.01
    ramp.request(wanted, math.inf)
    for step in range(300):
        ramp.step(step * step_s, step_s)
    fast = ramp.velocity
    ramp.request(wanted, 3.0)
    for step in range(math.ceil(LIMITS.braking_s(fast) / step_s + 1)):
        slower = ramp.step(3.0 + step * step_s, step_s)
        assert slower.linear * fast.angular == pytest.approx(slower.angular * fast.linear, abs=1e-9)
    assert ramp.velocity == STANDING
    assert ramp.standing


@given(linear=NUMBERS, angular=NUMBERS)
def test_wheels_and_body_are_inverse(linear: float, angular: float) -> None:
    drive = Differential(radius=0.1, separation=0.5)
    assert drive.body(*drive.wheels(Velocity(linear, 0.0, angular))) == pytest.approx((linear, 0.0, angular))
