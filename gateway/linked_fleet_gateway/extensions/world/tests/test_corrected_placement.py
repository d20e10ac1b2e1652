"""The placement at which a base stands where it was said to be."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from linked_fleet_gateway.extensions.world.relocalise import corrected, heading_of
from linked_fleet_state.kinematics import ORIGIN, compose
from linked_fleet_state.model import Pose

_METRES, _ANGLES = st.floats(-100, 100), st.floats(-math.pi, math.pi)
_POSES = st.tuples(
    st.tuples(_METRES, _METRES, _METRES), st.tuples(*[st.floats(-1, 1)] * 4).filter(lambda q: math.hypot(*q) > 0.1)
).map(lambda each: Pose(each[0], tuple(part / math.hypot(*each[1]) for part in each[1])))  # type: ignore[arg-type]


@given(_POSES, _POSES, _METRES, _METRES, _ANGLES)
def test_the_base_stands_where_it_was_said_to_be(
    placement: Pose, base: Pose, x: float, y: float, heading: float
) -> None:
    """Whatever the frame's placement was: height and tilt of the base stay, also those of legs."""
    found = corrected(placement, base, x, y, heading)
    if found is None:
        assert heading_of(compose(placement, base)) is None
        return
    before, stands = compose(placement, base), compose(found, base)
    looks = heading_of(stands)
    assert looks is not None and math.cos(looks - heading) == pytest.approx(1.0, abs=1e-6)
    assert stands.position_m == pytest.approx((x, y, before.position_m[2]), abs=1e-6)


def test_a_base_that_lies_on_its_back_end_has_no_heading() -> None:
    upright = Pose((0.0, 0.0, 0.0), (0.0, -math.sqrt(0.5), 0.0, math.sqrt(0.5)))
    assert corrected(ORIGIN, upright, 1.0, 2.0, 0.0) is None
