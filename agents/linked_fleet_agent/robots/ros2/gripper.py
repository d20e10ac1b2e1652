"""Grippers of ROS robots: the actions GripperCommand and ParallelGripperCommand of control_msgs."""

import math
from collections.abc import Callable, Mapping
from typing import Annotated, Any

from msgspec import Meta

from linked_fleet_agent.components import kinds
from linked_fleet_agent.components.call import Call
from linked_fleet_agent.components.component import Component, action, value
from linked_fleet_agent.components.schemas import unit
from linked_fleet_agent.robot import JointFacts
from linked_fleet_agent.robots.ros2.goal_runs import run_goal
from linked_fleet_agent.robots.ros2.goals import ABORTED, SUCCEEDED, ActionClient, GoalEnd

COMMAND, PARALLEL = "control_msgs/action/GripperCommand", "control_msgs/action/ParallelGripperCommand"
DURATION_S, STOP_S = 30.0, 2.0
_OPENED = 0.5
"""A gripper that has opened by this share of what it held between its fingers, or closed further, has lost it."""


_WIDEST = 10.0
Angle = Annotated[float, unit("RAD"), Meta(title="Position of the joint of the gripper")]
Effort = Annotated[float, Meta(ge=0, title="Highest effort, as the controller of the gripper counts it")]


class Claw:
    """One gripper by its action. Positions are those of its joint, in m or rad, as its controller counts them."""

    def __init__(self, client: ActionClient, joint: JointFacts, position: Callable[[], float]) -> None:
        self.client, self.joint, self.position = client, joint, position
        lower, upper = joint.limits.lower, joint.limits.upper
        self.closed, self.opened = lower or 0.0, _WIDEST if upper is None else upper
        self.force, self.held_at = math.nan, math.nan

    async def go(self, call: Call[Any], position: float, effort: float) -> GoalEnd:
        """Move the joint, with an effort of 0 for that which the controller is set up with. Raises ValueError."""
        self.held_at = math.nan
        end = await run_goal(
            call,
            self.client,
            self._goal(position, effort),
            lambda _: call.feedback(self.position()),
            (SUCCEEDED, ABORTED),
        )
        if end.status == ABORTED and not end.result["stalled"]:
            raise ValueError("its controller gave it up")
        return end

    def known_position(self) -> float:
        """Return the position. Raises ValueError while it is not known."""
        if math.isnan(found := self.position()):
            raise ValueError(f"the position of {self.joint.name} is not known")
        return found

    def note(self, end: GoalEnd) -> float:
        """Remember what a grasp has ended with, and return the position that its controller states."""
        self.force = abs(_number(end.result, "effort")) or math.nan
        position = _number(end.result, "position")
        stated = self.known_position() if math.isnan(position) else position
        self.held_at = stated if end.result["stalled"] else math.nan
        return stated

    def _goal(self, position: float, effort: float) -> dict[str, Any]:
        if self.client.type_name == COMMAND:
            return {"command": {"position": position, "max_effort": effort}}
        efforts = [effort] if effort else []
        return {"command": {"name": [self.joint.name], "position": [position], "effort": efforts}}

    @property
    def holding(self) -> bool:
        """True from a grasp that stalled until the fingers have moved further."""
        moved = abs(self.position() - self.held_at)
        return moved <= max(abs(self.held_at - self.closed) * _OPENED, 1e-3)


def _number(result: Mapping[str, Any], what: str) -> float:
    """Return the position or effort of a result: a number, or the first of a joint state."""
    said = result[what] if what in result else result["state"][what]
    return said if isinstance(said, float) else next(iter(said), math.nan)


def gripper_of(claw: Claw, name: str) -> Component:
    """Return the component of a gripper: of the known kind if its joint is measured in metres, else one of its own."""
    if claw.joint.linear:
        return _made(RosGripper, claw, name, grasp=_grasp(claw), open=_open(claw))
    return _made(TurningGripper, claw, name, move_to=_move_to(claw))


def _made(cls: type["_OfClaw"], claw: Claw, name: str, **actions: Any) -> Component:
    made: _OfClaw = type(cls.__name__, (cls,), actions)(claw)
    made.name = name
    made.__class__.__doc__ = cls.__doc__
    return made


class _OfClaw(Component):
    def __init__(self, claw: Claw) -> None:
        self.claw = claw


class RosGripper(_OfClaw, kinds.Gripper, blocking=False):
    """A gripper. Its width is the position of its joint, as its controller counts it."""

    def on_tick(self, now_s: float) -> None:
        claw = self.claw
        if not math.isnan(claw.held_at) and not claw.holding and not math.isnan(claw.position()):
            claw.held_at = math.nan
            self.lost()

    @value
    def width(self) -> kinds.Width:
        """Return the position of the joint of the gripper."""
        return self.claw.known_position()

    @value
    def force(self) -> kinds.Force:
        """Return the effort that the last grasp has ended with."""
        return self.claw.force

    @value
    def holding(self) -> kinds.Holding:
        """Tell whether the last grasp has stalled on something that is still there."""
        return self.claw.holding


class TurningGripper(_OfClaw, rename="camel", blocking=False):
    """A gripper whose joint turns. How far apart its fingers are is not known."""

    @value
    def position(self) -> Angle:
        """Return the position of the joint of the gripper."""
        return self.claw.known_position()

    @value
    def holding(self) -> kinds.Holding:
        """Tell whether the last motion has stalled on something that is still there."""
        return self.claw.holding


def _grasp(claw: Claw) -> Any:
    async def grasp(
        self: RosGripper, call: Call[kinds.Width], width: kinds.Width = claw.closed, force: kinds.Force = 0.0
    ) -> kinds.Grasped:
        """Close to a width, with at most this force; that which the gripper is set up with if none is given."""
        end = await claw.go(call, width, force)
        at = claw.note(end)
        return kinds.Grasped(at, end.result["stalled"], None if math.isnan(claw.force) else claw.force)

    return _action(claw, grasp, "width")


def _open(claw: Claw) -> Any:
    async def open(self: RosGripper, call: Call[kinds.Width], width: kinds.Width = claw.opened) -> None:
        """Open to a width, to the widest without one."""
        await claw.go(call, width, 0.0)

    return _action(claw, open, "width")


def _move_to(claw: Claw) -> Any:
    async def move_to(self: TurningGripper, call: Call[Angle], position: Angle, effort: Effort = 0.0) -> None:
        """Turn the joint, with at most this effort; that which the gripper is set up with if none is given."""
        claw.note(await claw.go(call, position, effort))

    return _action(claw, move_to, "position")


def _action(claw: Claw, method: Callable[..., Any], ranged: str) -> Any:
    """Return a method as an action that moves the joint, with the range of the parameter that is its position."""
    said = method.__annotations__[ranged]
    method.__annotations__[ranged] = Annotated[said, Meta(ge=claw.closed, le=claw.opened)]
    return action(moves=(claw.joint.name,), duration_s=DURATION_S, stop_s=STOP_S)(method)
