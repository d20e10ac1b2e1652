"""Paths that ideal bases follow: within the tolerance and the limits, to the last pose."""

import math
from collections.abc import Sequence
from itertools import pairwise

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from linked_fleet_agent.path_tracking import LOST_M, PathError, Tracker, from_here
from linked_fleet_agent.planar import STANDING, DriveLimits, Pose, Ramp, Velocity
from linked_fleet_agent.smooth_path import TOLERANCE_M
from paths import LEVEL_RAD, PLACE_M, apart, cut_m, off_m

WHEELS = DriveLimits(linear=1.0, angular=1.5, linear_acceleration=1.0, angular_acceleration=2.0)
SIDEWAYS = DriveLimits(linear=1.0, angular=2.0, linear_acceleration=2.0, angular_acceleration=4.0, lateral=0.5)
TICK_S = 0.01
SQUARE = [Pose(1, 0), Pose(1, 1), Pose(0, 1), Pose(0, 0)]
SLALOM = [Pose(0.5 * n, 0.3 * (n % 2), 0.0) for n in range(1, 9)]
ARC = [Pose(math.sin(n / 10), 1 - math.cos(n / 10), n / 10) for n in range(1, 32)]


class Drive:
    """An ideal base that has followed a path."""

    def __init__(
        self, path: Sequence[Pose], limits: DriveLimits, speed: float = 1.0, reverse: bool = False, share: float = 1.0
    ) -> None:
        self.path, self.limits = [Pose(), *path], limits
        self.poses, self.given, self.now_s = [Pose()], [STANDING], 0.0
        ramp, tracker = Ramp(limits), Tracker(Pose(), path, limits, speed, reverse)
        self.expected_s = Tracker(Pose(), path, limits, speed * share, reverse).duration_s
        while not tracker.finished and self.now_s < 2.0 * self.expected_s + 10.0:
            wanted = tracker.wanted(self.poses[-1], ramp.velocity, self.now_s, share)
            ramp.request(Velocity(*(each / share for each in wanted)), math.inf)
            self.now_s += TICK_S
            self.given.append(ramp.step(self.now_s, TICK_S, share))
            linear, lateral, angular = (each * TICK_S for each in self.given[-1])
            self.poses.append(self.poses[-1].moved(linear, angular, lateral))
        self.finished = tracker.finished

    def check(self) -> None:
        assert self.finished
        assert off_m(self.poses, self.path) <= TOLERANCE_M
        assert cut_m(self.poses, self.path) <= TOLERANCE_M
        distance_m, turn_rad = self.path[-1].error_of(self.poses[-1])
        assert distance_m <= PLACE_M
        assert turn_rad <= LEVEL_RAD
        assert self.given[-1] == STANDING
        self._check_limits()

    def _check_limits(self) -> None:
        limits = self.limits
        for before, now in pairwise(self.given):
            assert math.hypot(now.linear - before.linear, now.lateral - before.lateral) <= (
                limits.linear_acceleration * TICK_S + 1e-9
            )
            assert abs(now.angular - before.angular) <= limits.angular_acceleration * TICK_S + 1e-9
            assert limits.clamp(now) == pytest.approx(now, abs=1e-9)


@pytest.mark.parametrize("share", [1.0, 0.25])
@pytest.mark.parametrize("limits", [WHEELS, SIDEWAYS])
@pytest.mark.parametrize("path", [SQUARE, SLALOM, ARC, [Pose(0.3, 0.0, 2.0)], [Pose(0, 0, 3.0)], [Pose(-1, 0.002)]])
def test_a_base_follows_a_path(path: list[Pose], limits: DriveLimits, share: float) -> None:
    drive = Drive(path, limits, share=share)
    drive.check()
    assert drive.now_s == pytest.approx(drive.expected_s, rel=0.1, abs=1.0)


def test_a_base_slows_for_corners_and_does_not_stop_at_them() -> None:
    """It stops only where the path turns back."""
    drive = Drive([Pose(2, 0), Pose(3, 1), Pose(4, 1)], WHEELS)
    speeds = [each.linear for each in drive.given[100:-200]]
    assert max(speeds) == pytest.approx(1.0, abs=0.01)
    assert 0.1 < min(speeds) < 0.6
    back = Drive([Pose(1, 0), Pose(0.2, 0.1)], WHEELS)
    turning = [each for each in back.given if not each.linear and each.angular]
    assert sum(each.angular for each in turning) * TICK_S == pytest.approx(math.atan2(0.1, -0.8), abs=0.1) or turning


def test_a_base_with_wheels_turns_to_its_way_and_drives_backwards_only_if_asked() -> None:
    behind = [Pose(-1, 0, 0)]
    forwards, backwards = Drive(behind, WHEELS), Drive(behind, WHEELS, reverse=True)
    assert min(each.linear for each in forwards.given) >= 0.0
    assert max(abs(each.heading) for each in forwards.poses) == pytest.approx(math.pi, abs=0.01)
    assert max(each.linear for each in backwards.given) <= 0.0
    assert max(abs(each.heading) for each in backwards.poses) <= 0.01
    backwards.check()


def test_a_base_that_drives_sideways_takes_the_headings_on_its_way() -> None:
    drive = Drive([Pose(1, 0, 1.0), Pose(2, 0, 1.0), Pose(3, 0, -1.0)], SIDEWAYS)
    drive.check()
    half = min(drive.poses, key=lambda pose: abs(pose.x - 1.5))
    assert half.heading == pytest.approx(1.0, abs=0.05)
    assert max(abs(each.lateral) for each in drive.given) > 0.2


def test_the_speed_share_bounds_the_speed() -> None:
    drive = Drive([Pose(2, 0)], WHEELS, speed=0.3)
    assert max(each.linear for each in drive.given) == pytest.approx(0.3, abs=1e-6)


def test_a_base_that_is_far_off_its_path_does_not_go_on() -> None:
    tracker = Tracker(Pose(), [Pose(2, 0)], WHEELS)
    tracker.wanted(Pose(), STANDING, 0.01)
    with pytest.raises(PathError, match=rf"off its path by .*; {LOST_M:g} m is the most"):
        tracker.wanted(Pose(0.0, 0.3), Velocity(0.5), 0.02)


def test_a_new_path_is_joined_without_a_stop_where_it_goes_on_ahead() -> None:
    path = [Pose(0, 0), Pose(3, 0.1)]
    here, moving = Pose(0.4, 0.01), Velocity(0.6, 0.0, 0.05)
    tracker = Tracker(here, from_here(here, path), WHEELS)
    assert tracker.join(moving)
    assert tracker.wanted(here, moving, 1.0).linear == pytest.approx(0.6, abs=0.02)
    assert not Tracker(here, [Pose(0, 3)], WHEELS).join(moving), "it leads elsewhere"
    assert not Tracker(here, path, WHEELS).join(Velocity(-0.6)), "it moves backwards"
    assert from_here(Pose(0.4, 0.5), path) == path, "too far from the way"


POSES = st.builds(Pose, st.floats(-3, 3), st.floats(-3, 3), st.floats(-4, 4))
LIMITS = st.builds(
    DriveLimits, st.floats(0.2, 1.5), st.floats(0.4, 2.5), st.floats(0.4, 2.0), st.floats(0.8, 4.0),
    st.one_of(st.just(0.0), st.floats(0.2, 1.0)),
)  # fmt: skip


@given(
    path=st.lists(POSES, min_size=1, max_size=6), limits=LIMITS, speed=st.floats(0.3, 1.0), size=st.floats(0.05, 1.0)
)
@example(path=[*ARC, *SQUARE], limits=WHEELS, speed=1.0, size=1.0)
def test_any_path_is_followed_within_its_tolerance(
    path: list[Pose], limits: DriveLimits, speed: float, size: float
) -> None:
    Drive([Pose(size * x, size * y, heading) for x, y, heading in path], limits, speed).check()


@given(path=st.lists(POSES, min_size=2, max_size=5))
def test_poses_that_are_near_each_other_are_left_out(path: list[Pose]) -> None:
    near = [each._replace(x=each.x + shift) for each in path for shift in (0.0, 0.004, -0.003)]
    drive = Drive(near, WHEELS)
    drive.check()
    assert apart(near[-1], drive.poses[-1]) <= PLACE_M
