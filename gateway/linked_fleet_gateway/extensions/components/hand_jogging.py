"""Velocities of joints that move a link of a robot as it is asked to, by the Jacobian of Pinocchio. SI units.

Directions in which the link can hardly move, near a singularity, are damped (numerical filtering after A. Maciejewski
and C. Klein, "Numerical Filtering for the Operation of Robotic Manipulators through Kinematically Singular
Configurations", Journal of Robotic Systems 5(6), 1988), so that no joint races and the link keeps to the others.
"""

import math
from collections.abc import Collection, Mapping
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
import pinocchio as pin

from linked_fleet_agent.wire.schema import Schema
from linked_fleet_base.contributions import present
from linked_fleet_gateway.extensions.components.component import DeclaredComponent
from linked_fleet_gateway.extensions.components.hand_declaration import JOG_HAND, JOG_JOINTS
from linked_fleet_state.joint_chain import Chain, chain_to, known_position
from linked_fleet_state.kinematics import compose
from linked_fleet_state.model import JointKind, ModelError
from linked_fleet_state.robot import Robot
from linked_fleet_state.xml import rotation

Array = npt.NDArray[np.float64]

M_PER_RAD = 0.3
"""A turn by one radian counts like a way of so much."""
NEAR_SINGULAR, DAMPING = 0.06, 0.04
"""Singular values of the weighted Jacobian below the first one are damped, by up to the second one."""
LEAD_S = 0.08
"""The joints have moved on by so much when they follow: a sample waits for the next one, and a servo lags behind."""
_WORTH_TELLING = 0.98
_DIMENSIONS = 6


class CannotJogError(Exception):
    """A hand cannot be jogged now; the message says why."""


class Jogged(NamedTuple):
    """The input of the action that jogs joints, the share of the asked velocity that it gives, and why it is less."""

    input: dict[str, Any]
    share: float
    limited: str


def prepare(part: DeclaredComponent) -> None:
    """Make the first computation fast: build the usual hand. Call it in a thread. Raises CannotJogError."""
    action = part.declared.actions[JOG_HAND]
    assert action.input is not None
    _chain(part.robot, str(action.input.properties["link"].default))


def jogged(part: DeclaredComponent, given: Mapping[str, Any]) -> Jogged:
    """Return what the joints do for an input of ``jogHand``, from where they are now. Raises CannotJogError."""
    robot, said = part.robot, _with_defaults(part, given)
    twist = np.array([said[each].get(axis, 0.0) for each in ("linear", "angular") for axis in "xyz"])
    duration = {"duration": said["duration"]} if "duration" in said else {}
    if not twist.any():
        return Jogged({"velocities": {}, **duration}, 1.0, "")
    action = part.declared.actions[JOG_JOINTS]
    assert action.input is not None
    most = action.input.properties["velocities"].properties
    hand = _Hand(_chain(robot, said["link"]), robot, most.keys())
    asked = hand.in_root(twist, said["frame"], robot)
    velocities, share = hand.velocities(asked)
    limited = f"{said['link']} is near a singularity" if share < _WORTH_TELLING else ""
    shares = ((abs(each) / _limit(most[name]), name) for name, each in velocities.items())
    excess, fastest = max(shares, default=(0.0, ""))
    if excess > 1.0:
        velocities = {name: each / excess for name, each in velocities.items()}
        share, limited = share / excess, limited or f"{fastest} is at its highest speed"
    return Jogged({"velocities": velocities, **duration}, share, limited)


def _limit(schema: Schema) -> float:
    return math.inf if schema.maximum is None else float(schema.maximum)


def _with_defaults(part: DeclaredComponent, given: Mapping[str, Any]) -> dict[str, Any]:
    declared = part.declared.actions[JOG_HAND].input
    assert declared is not None
    usual = {name: declared.properties[name].default for name in ("frame", "link")}
    return {"linear": {}, "angular": {}, **usual, **given}


def _chain(robot: Robot, link: str) -> Chain:
    if robot.description is None:
        raise CannotJogError(f"robot {robot.name} has no description")
    try:
        return chain_to(robot.description.urdf, floating=False, link=link)
    except (ValueError, ModelError) as error:
        raise CannotJogError(str(error)) from error


class _Hand:
    """The Jacobian of a link at the present positions of a robot, in the axes of its root."""

    def __init__(self, chain: Chain, robot: Robot, jogged: Collection[str]) -> None:
        self.names = list(dict.fromkeys(each.driver for each in chain.joints if each.driver in jogged))
        try:
            positions = [known_position(each.name, robot.positions) for each in chain.joints]
        except ValueError as error:
            raise CannotJogError(str(error)) from error
        self._chain = chain
        gear = [each.factor * (each.driver == name) for each in chain.joints for name in self.names]
        self._gear = np.array(gear).reshape(len(chain.joints), len(self.names))
        self._at(np.array(positions) + LEAD_S * self._gear @ self._measured(robot))

    def _measured(self, robot: Robot) -> Array:
        """Return the measured velocities of the joints that are jogged; zero where they are unknown."""
        assert robot.description is not None
        frame = robot.frame
        known = {} if frame is None else dict(zip(robot.description.joints, frame.velocities, strict=True))
        measured: Array = np.nan_to_num(np.array([known.get(name, 0.0) for name in self.names]))
        return measured

    def _at(self, joints: Array) -> None:
        model, data, q = self._chain.model, self._chain.model.createData(), pin.neutral(self._chain.model)
        for each, joint, position in zip(list(model.joints)[1:], self._chain.joints, joints.tolist(), strict=True):
            if joint.kind is JointKind.CONTINUOUS:
                q[each.idx_q], q[each.idx_q + 1] = math.cos(position), math.sin(position)
            else:
                q[each.idx_q] = position
        pin.computeJointJacobians(model, data, q)
        self._rotation: Array = pin.updateFramePlacement(model, data, self._chain.frame).rotation
        jacobian = pin.getFrameJacobian(model, data, self._chain.frame, pin.LOCAL_WORLD_ALIGNED)
        self._jacobian: Array = jacobian.reshape(_DIMENSIONS, model.nv) @ self._gear

    def in_root(self, twist: Array, frame: str, robot: Robot) -> Array:
        """Return a twist in the axes of the root of the robot."""
        turn = np.eye(3) if frame == "root" else self._rotation if frame == "hand" else _world_in_root(robot)
        return np.concatenate((turn @ twist[:3], turn @ twist[3:]))

    def velocities(self, twist: Array) -> tuple[dict[str, float], float]:
        """Return the velocities of the joints, and the share of the twist that they give."""
        weights = np.array([1.0] * 3 + [M_PER_RAD] * 3)
        rows = slice(3 if len(self.names) < _DIMENSIONS and not twist[3:].any() else _DIMENSIONS)
        jacobian, asked = (weights[:, None] * self._jacobian)[rows], (weights * twist)[rows]
        left, sizes, right = np.linalg.svd(jacobian, full_matrices=False)
        damping = DAMPING**2 * np.clip(1.0 - (sizes / NEAR_SINGULAR) ** 2, 0.0, 1.0)
        found = right.T @ ((left.T @ asked) * sizes / (sizes**2 + damping))
        share = float(asked @ (jacobian @ found) / (asked @ asked))
        return dict(zip(self.names, found.tolist(), strict=True)), min(max(share, 0.0), 1.0)


def _world_in_root(robot: Robot) -> Array:
    """Return the rotation from the axes of the world into those of the root of a robot."""
    pose = None if robot.model is None else robot.link_pose(robot.model.root)
    placed = next((found for each in present().placements if (found := each(robot)) is not None), None)
    if placed is None or pose is None:
        raise CannotJogError(f"{robot.name} has no placement, so the axes of the world are unknown")
    return np.array(rotation(compose(placed, pose).orientation_xyzw)).T
