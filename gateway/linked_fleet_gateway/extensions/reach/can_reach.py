"""The query function ``lf:canReach``, and the terms of the extension.

The function is True if joints within their limits can bring the origin of a link to a point.
"""

import logging
import math
from collections.abc import Collection, Mapping
from importlib import import_module
from typing import TYPE_CHECKING

from pyoxigraph import Literal, NamedNode

from linked_fleet_base.lazy_imports import LazyModule
from linked_fleet_gateway.extensions.reach.envelope import envelope
from linked_fleet_gateway.faces import commandable_joints, thing_at
from linked_fleet_rdf.vocabulary import LF as CORE
from linked_fleet_state.functions import Function, Term, path_of
from linked_fleet_state.kinematics import ORIGIN, base_pose, compose, inverse
from linked_fleet_state.model import JointKind, Link, ModelError, Pose
from linked_fleet_state.robot import Robot
from linked_fleet_state.xml import Vector

if TYPE_CHECKING:
    from linked_fleet_gateway.extensions.reach import inverse_kinematics as solver
else:
    solver = LazyModule("linked_fleet_gateway.extensions.reach.inverse_kinematics", "pinocchio", "numpy")

log = logging.getLogger(__name__)

LF = CORE.extended("Reach canReach")

TOLERANCE_M = 5e-5


class CanReach:
    """Implements ``linked_fleet_state.functions.FleetFunctions``."""

    names = (LF.canReach,)

    def prepare(self) -> None:
        _ = solver.reach
        import_module("numpy.random")  # numpy imports it lazily

    def bind(self, base: str, robots: Mapping[str, Robot]) -> dict[NamedNode, Function]:
        known: dict[tuple[str, Vector], bool] = {}

        def can_reach(*said: Term) -> Literal | None:
            """Coordinates are in the frame of the robot's root link (m), or in the world for a floating base.

            Obstacles are ignored. An unknown answer is an expression error.
            """
            found = _link(base, robots, said[0]) if len(said) == 4 else None
            x, y, z = map(_metres, said[1:]) if len(said) == 4 else (None, None, None)
            if found is None or x is None or y is None or z is None:
                return None
            key = said[0].value, (x, y, z)  # type: ignore[union-attr]  # a link is named by an IRI
            if key not in known:
                answer = _reaches(*found, key[1])
                if answer is None:
                    return None
                known[key] = answer
            return Literal(known[key])

        return {LF.canReach: can_reach}


def _link(base: str, robots: Mapping[str, Robot], term: Term) -> tuple[Robot, str] | None:
    robot, part = thing_at(path_of(base, term), robots) or (None, None)
    return (robot, part.name) if robot is not None and isinstance(part, Link) else None


def _metres(term: Term) -> float | None:
    try:
        value = float(term.value) if isinstance(term, Literal) else math.nan
    except ValueError:
        return None
    return value if math.isfinite(value) else None


def _reaches(robot: Robot, link: str, place: Vector) -> bool | None:
    description, frame, able = robot.description, robot.frame, commandable_joints(robot)
    if description is None or frame is None:
        return None
    movable = [joint.name for joint in able]
    limits = {
        joint.name: (joint.limits.lower, joint.limits.upper)
        for joint in able
        if joint.kind is not JointKind.CONTINUOUS and joint.limits.lower is not None and joint.limits.upper is not None
    }
    if _beyond(robot, link, movable, place):
        return False
    floating = description.base == "floating"
    try:
        solver.reach(
            description.urdf, floating, link, place, None, dict(robot.positions), limits, movable, frame.base,
            "world" if floating else "base",
        )  # fmt: skip
    except solver.Unreachable:
        return False
    except (ModelError, ValueError):
        return None
    except Exception:
        # Logged here, because the store takes any exception for an expression error and reports nothing.
        log.exception("lf:canReach failed")
        raise
    return True


def _beyond(robot: Robot, link: str, movable: Collection[str], place: Vector) -> bool:
    """Return True if the point is outside the sphere of reachable positions."""
    assert robot.model is not None and robot.description is not None and robot.frame is not None
    root = base_pose(robot.frame.base) if robot.description.base == "floating" else ORIGIN
    if root is None:
        return False
    at = compose(inverse(root), Pose(place, ORIGIN.orientation_xyzw)).position_m
    return not envelope(robot.model, link, movable).contains(at, TOLERANCE_M)
