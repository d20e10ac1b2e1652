"""Forward kinematics of one robot on Pinocchio. Metre and radian; a pose that cannot be known is None."""

import math
from collections.abc import Mapping

import numpy as np
import pinocchio as pin

from agents.wire.messages import Base
from gateway.fleet.model import ModelError, Pose

_FREE_FLYER_NQ = 7
# Pinocchio's Data holds tensors of nv³: 128 take 0.3 s and 150 MB, 512 take 20 s and 9 GB, and a URDF is hostile.
MAX_DEGREES = 128


def build_model(urdf: str, floating: bool) -> pin.Model:
    """Pinocchio's model; ModelError when it refuses the URDF or that has more than ``MAX_DEGREES`` of freedom."""
    try:
        model = pin.buildModelFromXML(urdf, pin.JointModelFreeFlyer()) if floating else pin.buildModelFromXML(urdf)
    except (ValueError, RuntimeError) as error:
        raise ModelError(f"Pinocchio refuses the URDF: {error}") from error
    if model.nv > MAX_DEGREES:
        raise ModelError(f"{model.nv} degrees of freedom are too many for link poses; {MAX_DEGREES} are not")
    return model


class Kinematics:
    """Link poses from joint positions. ``floating`` puts a free joint between the world and the root link.

    Raises ModelError as ``build_model`` does. Mimic joints are plain joints here: their positions come with the others.
    Joints of six or three degrees inside the tree have no position in a frame, so all below is unknown.
    """

    def __init__(self, urdf: str, floating: bool) -> None:
        self._model = build_model(urdf, floating)
        self._data = self._model.createData()
        self._floating = floating
        joints = self._model.joints
        self._joints = [
            (name, joints[i].idx_q, joints[i].nq, self._model.parents[i])
            for i, name in enumerate(self._model.names)
            if i > int(floating)
        ]
        self._frames = [
            (frame.name, index, frame.parentJoint)
            for index, frame in enumerate(self._model.frames)
            if frame.type == pin.FrameType.BODY
        ]

    def link_poses(self, positions: Mapping[str, float], base: Base | None) -> dict[str, Pose | None]:
        """The pose of every link in the world frame; with a fixed base that is the frame of the root link.

        None for a link behind a joint whose position is missing or NaN, and for all while a floating base is unknown.
        """
        q = pin.neutral(self._model)
        known = [True]
        if self._floating:
            known.append(_set_base(q, base))
        for name, index, nq, parent in self._joints:
            known.append(known[parent] and _set_joint(q, index, nq, positions.get(name, math.nan)))
        pin.framesForwardKinematics(self._model, self._data, q)
        return {name: _pose(self._data.oMf[index]) if known[joint] else None for name, index, joint in self._frames}


def _set_base(q: "np.ndarray[tuple[int], np.dtype[np.float64]]", base: Base | None) -> bool:
    if base is None:
        return False
    values = (*base.position_m, *base.orientation_xyzw)
    length = math.hypot(*base.orientation_xyzw)
    if not all(map(math.isfinite, values)) or length < 1e-6:
        return False
    q[:_FREE_FLYER_NQ] = values
    q[3:_FREE_FLYER_NQ] /= length
    return True


def _set_joint(q: "np.ndarray[tuple[int], np.dtype[np.float64]]", index: int, nq: int, position: float) -> bool:
    if not math.isfinite(position) or nq > 2:
        return False
    # Pinocchio keeps an unbounded rotation as a point on the circle.
    q[index : index + nq] = position if nq == 1 else (math.cos(position), math.sin(position))
    return True


def _pose(placement: pin.SE3) -> Pose | None:
    x, y, z, qx, qy, qz, qw = pin.SE3ToXYZQUAT(placement).tolist()
    if not math.isfinite(x + y + z + qx + qy + qz + qw):
        return None  # finite positions of absurd size overflow on the way
    return Pose((x, y, z), (qx, qy, qz, qw))
