"""The joints between the root of a robot and one of its links, with their mimics and limits. Metre and radian."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache

import pinocchio as pin

from linked_fleet_state.model import Joint, JointKind, ModelError, RobotModel
from linked_fleet_state.pinocchio_model import build_model

Positions = Mapping[str, float]
Limits = Mapping[str, tuple[float, float]]
FAR = 1e6
"""A length in m or a position in rad that no robot reaches, and whose square cannot overflow."""
_MOST_NQ = 2  # of a joint with one degree of freedom
_STEEPEST = 1e3  # factor of a mimic joint


@dataclass(frozen=True)
class ChainJoint:
    """A joint at ``factor`` times the position of ``driver`` (itself unless it mimics) plus ``offset``."""

    name: str
    kind: JointKind
    driver: str
    factor: float
    offset: float


@dataclass(frozen=True)
class Chain:
    """The joints between root and link, in order. Shared by threads and immutable."""

    model: pin.Model
    frame: int
    joints: tuple[ChainJoint, ...]
    continuous: frozenset[str]  # of the whole robot


@lru_cache(maxsize=64)
def chain_to(urdf: str, floating: bool, link: str, carried: bool = False) -> Chain:
    """Return the joints from the root to ``link``; if ``carried``, from the link on the last floating or planar joint.

    Raises ValueError for an unknown link, ModelError for a robot that is too large to compute.
    """
    robot, whole = _whole(urdf, floating)
    if link not in robot.links:
        raise ValueError(f"the robot has no link {link[:128]!r}")
    body = whole.frames[whole.getFrameId(link, pin.FrameType.BODY)]
    # buildReducedModel refuses a joint that shares its name with a link. The free joint of the base comes first.
    above = [i for i in whole.supports[body.parentJoint] if i > int(floating)]
    if carried:
        above = above[1 + max((place for place, i in enumerate(above) if whole.joints[i].nq > _MOST_NQ), default=-1) :]
    model, last = pin.Model(), 0
    for i in above:
        last = model.addJoint(last, whole.joints[i], whole.jointPlacements[i], f"{i}")
    frame = model.addFrame(pin.Frame("link", last, 0, body.placement, pin.FrameType.OP_FRAME))
    if not sum(math.hypot(*at.translation) for at in (*model.jointPlacements[1:], body.placement)) < FAR:
        raise ModelError(f"the robot is more than {FAR / 1000:.0f} km long")
    joints = tuple(_joint(robot, robot.joints[whole.names[i]]) for i in above)
    continuous = frozenset(joint.name for joint in robot.joints.values() if joint.kind is JointKind.CONTINUOUS)
    return Chain(model, frame, joints, continuous)


@lru_cache(maxsize=16)
def _whole(urdf: str, floating: bool) -> tuple[RobotModel, pin.Model]:
    """Return the parsed robot, cached because parsing takes longer than most searches.

    Shared by threads and immutable.
    """
    return RobotModel.for_urdf(urdf), build_model(urdf, floating)


def _joint(robot: RobotModel, joint: Joint) -> ChainJoint:
    if not joint.movable:
        raise ValueError(
            f"the position of {joint.kind} joint {joint.name!r} is unknown. A pose in the frame of link "
            f'{joint.child!r} on it has the lf:frame "base"'
        )
    driver, factor, offset = joint, 1.0, 0.0
    while driver.mimic is not None:
        mimic = driver.mimic
        offset += factor * mimic.offset
        factor *= mimic.multiplier
        driver = robot.joints[mimic.joint]
        if not max(abs(factor), abs(offset)) <= _STEEPEST:
            return ChainJoint(joint.name, joint.kind, "", 0.0, 0.0)
    return ChainJoint(joint.name, joint.kind, driver.name, factor, offset)


def known_position(name: str, start: Positions) -> float:
    """Return the position of a joint. Raises ValueError if it is unknown, or further from zero than any robot's."""
    position = start.get(name, math.nan)
    if not abs(position) <= FAR:
        raise ValueError(f"the position of joint {name!r} is {'unknown' if math.isnan(position) else 'absurd'}")
    return position


def bounds_of(chain: Chain, name: str, present: float, limits: Limits) -> tuple[float, float]:
    """Return the limits of a joint, including those of the joints that mimic it. Raises ValueError if none are left."""
    ends = [_limits(name, limits)]
    for joint in chain.joints:
        if joint.driver == name and joint.factor:
            follows = [(end - joint.offset) / joint.factor for end in _limits(joint.name, limits)]
            ends.append((min(follows), max(follows)))
    if name in chain.continuous and not has_unlimited_rotation(chain, name):
        ends.append((present - math.pi, present + math.pi))
    lower, upper = max(low for low, _ in ends), min(high for _, high in ends)
    if not max(lower, -FAR) <= min(upper, FAR):
        raise ValueError(f"the limits of joint {name!r}, or of those that mimic it, leave it no position")
    return lower, upper


def _limits(name: str, limits: Limits) -> tuple[float, float]:
    lower, upper = limits.get(name, (-math.inf, math.inf))
    if not lower <= upper:
        raise ValueError(f"joint {name!r} cannot have the limits {lower} and {upper}")
    return lower, upper


def has_unlimited_rotation(chain: Chain, name: str) -> bool:
    """Return True if whole turns of this joint leave the link in place."""
    followers = [joint for joint in chain.joints if joint.driver == name and joint.factor]
    return all(joint.kind is not JointKind.PRISMATIC and joint.factor.is_integer() for joint in followers)
