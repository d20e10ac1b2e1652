"""Motions that wait at their start until other robots have passed."""

import asyncio
import math

from msgspec.structs import replace

from linked_fleet_agent.wire.messages import Expectation
from linked_fleet_base.errors import MotionRefused
from linked_fleet_gateway.api import Motion, Robot
from linked_fleet_gateway.extensions.world.collisions import Collides
from linked_fleet_gateway.extensions.world.messages import Positions
from linked_fleet_gateway.extensions.world.questions import Questions
from linked_fleet_state.model import JointKind

MOST_WAIT_S = 10.0
"""The longest that a motion waits at its start."""
STILL_RAD, STILL_M = 0.01, 0.001
"""Largest distance of a joint from the begin of its path when the robot gets the command."""
_SHARES, _LEAST_S = (0.5, 1.0), 0.1
"""Shares of the time until the way is free after which it is tried, and the shortest wait."""
_CURVE_SHARE = 0.97
"""Share of the speed of a motion that waits: it is a curve through waypoints, which is faster here and there."""


def standing(robot: Robot, start: Positions) -> dict[str, Expectation]:
    """Return the expectation that joints stand where their path begins."""
    joints = {} if robot.model is None else robot.model.joints
    linear = {name for name, joint in joints.items() if joint.kind is JointKind.PRISMATIC}
    return {name: Expectation(at, STILL_M if name in linear else STILL_RAD) for name, at in start.items()}


class Waits:
    """The direct path of a motion after waits, if its refusal has said that it will be free soon."""

    def __init__(self, questions: Questions, motion: Motion, own_id: str) -> None:
        self._questions, self._motion, self._own_id = questions, motion, own_id
        self._free_s, self._shares = math.inf, list(_SHARES)

    def note(self, refused: MotionRefused | None) -> None:
        """Note when the way will be free."""
        after_s = refused.after_s if isinstance(refused, Collides) else None
        if after_s is not None and after_s <= MOST_WAIT_S:
            self._free_s = _now_s() + after_s

    @property
    def help(self) -> bool:
        """True if it is known when the way will be free."""
        return self._free_s < math.inf

    def next(self, because: str) -> Motion | None:
        """Return the motion after a longer wait than before; None after the longest one."""
        if not self.help or not self._shares:
            return None
        wait_s = max(self._shares.pop(0) * (self._free_s - _now_s()), _LEAST_S)
        motion = self._motion
        slower = replace(motion, speed_scale=_CURVE_SHARE * motion.speed_scale)
        course = self._questions.course(slower, self._own_id)
        if course is None:
            return None
        expected = standing(motion.robot, course.start) | dict(motion.expectations)
        detour = f"{because}, so it waits {wait_s:.1f} s for another robot to pass"
        return replace(motion, motion=course.after(wait_s), expectations=expected, detour=detour)


def _now_s() -> float:
    return asyncio.get_running_loop().time()
