"""The extension ``reach``: inverse kinematics as the action ``reach``, and as a function of queries.

The action computes joint positions for a validated body. Its error is ``OutOfReach`` (422, out-of-reach).
"""

import math
from collections.abc import AsyncIterator, Callable, Mapping
from contextlib import asynccontextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from msgspec.structs import replace
from pyoxigraph import NamedNode

from linked_fleet_agent.wire.messages import Move
from linked_fleet_base.errors import Conflict, Members, Offline, UnprocessableContent
from linked_fleet_base.lazy_imports import LazyModule
from linked_fleet_gateway.api import ActionRequest, Core, DeferredPlan, Extension, Motion, Mount, build_motion
from linked_fleet_gateway.extensions.reach.can_reach import LF, CanReach
from linked_fleet_gateway.faces import commandable_joints
from linked_fleet_rdf.graph import Node
from linked_fleet_rdf.vocabulary import MATHS
from linked_fleet_state.kinematics import loose_joint
from linked_fleet_state.model import JointKind, ModelError
from linked_fleet_state.robot import Robot

if TYPE_CHECKING:
    from linked_fleet_gateway.extensions.reach import inverse_kinematics as solver
else:
    solver = LazyModule("linked_fleet_gateway.extensions.reach.inverse_kinematics", "pinocchio", "numpy")


class OutOfReach(UnprocessableContent):
    """No joint positions reach the pose; the residuals are in m and rad (0 without a target orientation)."""

    code, title = "out-of-reach", "The pose cannot be reached"

    def __init__(self, detail: str, *, residual_m: float, residual_rad: float) -> None:
        super().__init__(detail)
        self.residual_m, self.residual_rad = residual_m, residual_rad

    @property
    def members(self) -> Members:
        return super().members | {"residual_m": self.residual_m, "residual_rad": self.residual_rad}


_UNIT_LENGTH = 1e-3  # tolerance of a quaternion's length

Search = Callable[[], tuple[Mapping[str, float], Mapping[str, float]]]


def reach(request: ActionRequest) -> DeferredPlan:
    """Bring a link to a pose. The search takes milliseconds, so it runs in a worker."""
    plain, search = build_motion(request, Move({"": 0.0}), {}), prepare_search(request)

    def compute() -> Motion:
        targets, facts = search()
        return replace(plain, motion=Move(dict(targets)), targets=targets, facts=facts)

    return DeferredPlan(compute)


def prepare_search(request: ActionRequest, start: Mapping[str, float] | None = None) -> Search:
    """Prepare the search, which returns targets (rad or m) and residuals (m, rad).

    It begins at the present positions, some of them replaced by those in ``start``.

    The search raises OutOfReach with the best residual. Raises Offline or Conflict if the pose of the robot is unknown.
    """
    robot, body, root = request.required_robot(), request.body, request.body.root
    description, frame = robot.description, robot.frame
    if description is None or frame is None:
        raise Offline(f"The joint positions of robot {robot.name} are unknown, so nothing can be planned.")
    link = request.link_at(body.node(root, LF.ofLink))
    position = _vector(request, body.node(root, LF.position))
    orientation = _quaternion(request, body.node(root, LF.orientation))
    floating = description.base == "floating"
    said = body.text(root, LF.frame)
    in_frame = _frame(robot, link, said, floating)
    able = commandable_joints(robot)
    limits = {
        joint.name: (joint.limits.lower, joint.limits.upper)
        for joint in able
        if joint.kind is not JointKind.CONTINUOUS and joint.limits.lower is not None and joint.limits.upper is not None
    }
    start, urdf, movable, base = (
        {**robot.positions, **(start or {})},
        description.urdf,
        [joint.name for joint in able],
        frame.base,
    )

    def search() -> tuple[Mapping[str, float], Mapping[str, float]]:
        try:
            found = solver.reach(urdf, floating, link, position, orientation, start, limits, movable, base, in_frame)
        except solver.Unreachable as error:
            best = error.best
            raise OutOfReach(str(error), residual_m=best.residual_m, residual_rad=best.residual_rad) from error
        except ModelError as error:
            raise Conflict(f"Robot {robot.name} has no kinematics: {error}") from error
        except ValueError as error:
            raise Conflict(f"Nothing can be planned from the present state of the robot: {error}") from error
        facts = {"positionResidual": found.residual_m}
        if orientation is not None:
            facts["orientationResidual"] = found.residual_rad
        return found.positions, facts

    return search


def _frame(robot: Robot, link: str, said: str | None, floating: bool) -> Literal["base", "world", "carried"]:
    """Return the frame of a pose: ``carried`` for the base of a link on a floating or planar joint."""
    if said == "world" or (said is None and floating):
        return "world"
    carried = said == "base" and robot.model is not None and loose_joint(robot.model, link) is not None
    return "carried" if carried else "base"


def _vector(request: ActionRequest, node: Node | None) -> tuple[float, float, float]:
    assert node is not None
    scale = request.body.unit(node)
    x, y, z = (_number(request, node, axis) * scale for axis in (MATHS.x, MATHS.y, MATHS.z))
    return x, y, z


def _quaternion(request: ActionRequest, node: Node | None) -> tuple[float, float, float, float] | None:
    if node is None:
        return None
    x, y, z, w = (_number(request, node, axis) for axis in (MATHS.x, MATHS.y, MATHS.z, LF.w))
    length = math.hypot(x, y, z, w)
    if abs(length - 1.0) > _UNIT_LENGTH:
        raise UnprocessableContent(f"The quaternion has length {length:.6g}; an orientation has length 1.")
    return x / length, y / length, z / length, w / length


def _number(request: ActionRequest, node: Node, axis: NamedNode) -> float:
    value = request.body.number(node, axis)
    assert value is not None
    return value


class ReachExtension(Extension):
    name = "reach"
    vocabulary = (Path(__file__).with_name("vocabulary.ttl"),)
    kinds = (Path(__file__).with_name("reach.ttl"),)
    functions = (CanReach,)

    @asynccontextmanager
    async def start(self, core: Core) -> AsyncIterator[Mount]:
        yield Mount(handlers={LF.Reach: reach})
