"""Orientations in URDF: two notations of one pose, and their way to other readers."""

import math

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given
from hypothesis import strategies as st

from linked_fleet_agent.urdf.poses import quaternion, roll_pitch_yaw, rotation

_ANGLES = st.floats(-4, 4) | st.sampled_from([0.0, 1.5708, -1.5708, math.pi / 2, -math.pi / 2, math.pi, 1e-9])


@given(st.tuples(_ANGLES, _ANGLES, _ANGLES))
def test_roll_pitch_and_yaw_of_a_quaternion_give_the_same_rotation(rpy: tuple[float, float, float]) -> None:
    there = np.array(rotation(quaternion(rpy)))
    back = pin.rpy.rpyToMatrix(np.array(roll_pitch_yaw(quaternion(rpy))))
    assert there == pytest.approx(back, abs=1e-14)
    assert there == pytest.approx(pin.rpy.rpyToMatrix(np.array(rpy)), abs=1e-14)
