"""The path of a plan that was kept: taken as it was rehearsed, or refused because something has changed."""

import logging
import math
import time
from collections.abc import Iterator

from msgspec.structs import replace

from linked_fleet_agent.wire.messages import Follow, Move
from linked_fleet_base.errors import MotionRefused
from linked_fleet_gateway.api import Motion, Pose, RedisUnavailable, Robot, RobotModel
from linked_fleet_gateway.extensions.planning.errors import PlanChanged
from linked_fleet_gateway.extensions.planning.kept_plans import KEPT_S, Found, KeptPlans, Plan, digest_of
from linked_fleet_gateway.extensions.planning.waiting import STILL_M, STILL_RAD, standing
from linked_fleet_gateway.extensions.world.collisions import Collides
from linked_fleet_gateway.extensions.world.placement import pose_in_world
from linked_fleet_gateway.serving import Caller, Live, Paths
from linked_fleet_state.kept_plan import KeptPlan
from linked_fleet_state.model import JointKind

_FIND_S = 5.0

log = logging.getLogger(__name__)


def tolerance_of(robot: Robot, joint: str) -> float:
    """Return how far a joint may be from where its path begins (rad or m)."""
    assert robot.model is not None
    return STILL_M if robot.model.joints[joint].kind is JointKind.PRISMATIC else STILL_RAD


def moving_joint(live: Live, motion: Motion, own_id: str) -> str | None:
    """Return a joint of a motion that another motion moves now, if there is one and it begins from here."""
    if motion.robot.name in motion.assumed:
        return None
    for each in live.invocations.open_of_robot(motion.robot.name):
        moving = each.targets.keys() & motion.targets.keys() if each.id != own_id else ()
        if moving:
            return min(moving)
    return None


def above(model: RobotModel, joint: str) -> Iterator[str]:
    """Yield the joints that carry a joint, the nearest first."""
    while (parent := model.links[model.joints[joint].parent].parent_joint) is not None:
        yield parent
        joint = parent


async def keep(plans: KeptPlans, motion: Motion, client: str) -> KeptPlan | None:
    """Keep a rehearsed motion; None if there is no room for it, or no place to keep it."""
    robot, request, moved = motion.robot, motion.request, motion.motion
    base = None if robot.model is None else pose_in_world(robot, robot.model.root)
    if robot.model is None or request is None or base is None or not isinstance(moved, Move | Follow):
        return None
    relevant = {*motion.targets, *(each for name in motion.targets for each in above(robot.model, name))}
    stands = {name: robot.positions[name] for name in relevant if name in robot.positions}
    begins = standing(robot, {name: stands[name] for name in motion.targets})
    plan = Plan(
        client,
        digest_of(request),
        moved,
        dict(motion.targets),
        stands,
        base,
        motion.speed_scale,
        begins | dict(motion.expectations),
        dict(motion.facts),
        motion.detour,
    )
    try:
        return await plans.keep(plan)
    except RedisUnavailable as error:
        log.warning("a rehearsed motion of %s is not kept: %s", robot.name, error)
        return None


class KeptPath(Paths):
    """The one path of a plan."""

    most_s = _FIND_S

    def __init__(self, plans: KeptPlans, live: Live, motion: Motion, caller: Caller, own_id: str, id: str) -> None:
        self._plans, self._live, self._motion, self._caller = plans, live, motion, caller
        self._own_id, self._id = own_id, id
        self._left_s = 0

    async def next(self, refused: MotionRefused | None) -> Motion | None:
        """Return the motion of the plan; None if it could not be checked. Raises PlanChanged, RedisUnavailable."""
        if refused is None:
            found = await self._plans.find(self._id)
            plan, self._left_s = self._checked(found), 0 if found is None else found.left_s
            return replace(
                self._motion,
                motion=plan.motion,
                targets=plan.targets,
                facts=plan.facts,
                expectations=plan.expectations,
                detour=plan.detour,
            )
        if refused.status == PlanChanged.status:
            met = refused if isinstance(refused, Collides) else None
            raise PlanChanged(
                f"Since the rehearsal something has changed: {refused.detail}", reason=refused.reason, met=met
            )
        return None

    async def keep(self, motion: Motion) -> KeptPlan | None:
        """Return the plan itself, which is kept no longer than it was."""
        return KeptPlan(self._id, time.time_ns() + self._left_s * 10**9)

    def _checked(self, found: Found | None) -> Plan:
        """Return the plan if its request is the same, and the robot stands as it did. Raises PlanChanged."""
        if found is None or found.plan.client != self._caller.name:
            raise _changed(
                f"There is no such plan, or none any more: a plan is kept for {KEPT_S} s, for the client that has "
                "rehearsed it",
                "its plan is kept no longer",
            )
        plan, motion = found.plan, self._motion
        assert motion.request is not None
        if plan.request != digest_of(motion.request):
            raise _changed(
                "The request is another one than the one that was rehearsed; the same one has lf:plan in addition",
                "the request is another one than was rehearsed",
            )
        if plan.speed_scale != motion.speed_scale:
            raise _changed(
                f"The speed scale of the motion is {motion.speed_scale:g} now, and was {plan.speed_scale:g}",
                "its speed scale has changed",
            )
        self._check_place(plan)
        return plan

    def _check_place(self, plan: Plan) -> None:
        """Check that the robot stands where the plan begins. Raises PlanChanged."""
        robot = self._motion.robot
        here = None if robot.model is None else pose_in_world(robot, robot.model.root)
        if here is None or _is_elsewhere(here, plan.base):
            raise _changed(f"The placement of {robot.name} has changed", "its placement has changed")
        if (moving := moving_joint(self._live, self._motion, self._own_id)) is not None:
            raise _changed(f"{moving} of {robot.name} is moving, and the path begins where it stood", "it is moving")
        for name, stood in plan.stands.items():
            now = robot.positions.get(name, math.nan)
            if not abs(now - stood) <= tolerance_of(robot, name):
                raise _changed(
                    f"{name} of {robot.name} is at {now:.4g}, and the path begins at {stood:.4g} (rad or m)",
                    f"{name} is not where the path begins",
                )


def _changed(what: str, reason: str) -> PlanChanged:
    return PlanChanged(f"{what}. Rehearse the motion again.", reason=reason)


def _is_elsewhere(one: Pose, other: Pose) -> bool:
    dot = abs(sum(a * b for a, b in zip(one.orientation_xyzw, other.orientation_xyzw, strict=True)))
    return math.dist(one.position_m, other.position_m) > STILL_M or 2 * math.acos(min(dot, 1.0)) > STILL_RAD
