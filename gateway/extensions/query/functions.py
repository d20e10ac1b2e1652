"""Functions that queries can call beside SPARQL's own: ``lf:canReach``, ``lf:poseIn`` and ``lf:distance``."""

import logging
import math
from collections.abc import Callable, Collection, Mapping
from importlib import import_module
from typing import TYPE_CHECKING

from pyoxigraph import BlankNode, Literal, NamedNode, Triple

from gateway.base.lazy_imports import Lazily
from gateway.extensions.query.messages import Ask, Placed
from gateway.fleet.envelope import envelope
from gateway.fleet.kinematics import ORIGIN, compose, inverse, placed
from gateway.fleet.model import JointKind, ModelError, Pose
from gateway.fleet.robot import Robot
from gateway.fleet.xml import Vector
from gateway.rdf.graph import number
from gateway.rdf.vocabulary import LF
from gateway.resources.paths import part_of, robot_name
from gateway.resources.relative_poses import rounded, seen_from
from gateway.resources.shape_parameters import commandable

TOLERANCE_M = 5e-5
_SOLVER = "gateway.extensions.reach.inverse_kinematics"
if TYPE_CHECKING:
    from gateway.extensions.reach import inverse_kinematics as solver
else:
    solver = Lazily(_SOLVER, "pinocchio", "numpy")

log = logging.getLogger(__name__)

Term = NamedNode | BlankNode | Literal | Triple


def prepare(ask: Ask) -> None:
    """Load what the query will need: afterwards no file can be opened."""
    if LF.canReach.value.rpartition("#")[2] in ask.query:
        import_module(_SOLVER)
        import_module("numpy.random")  # which numpy imports when it is first used


FUNCTIONS = (LF.canReach, LF.poseIn, LF.distance)
COMPONENTS = ("x", "y", "z", "qx", "qy", "qz", "qw")
"""The parts of a pose: position (m) and unit quaternion."""


def functions_of(
    base: str, robots: Mapping[str, Robot], objects: Mapping[str, Placed]
) -> dict[NamedNode, Callable[..., Term | None]]:
    """The functions, for these robots and objects and no others. None is an error of the expression."""
    known: dict[tuple[str, Vector], bool] = {}

    def can_reach(*said: Term) -> Literal | None:
        """Whether joints within their limits bring the origin of a link there (m): in the frame of the robot's root
        link, in the world if its base floats. Not whether anything is in the way. An error where that is unknown."""
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

    def pose_in(*said: Term) -> Term | None:
        """One component of the pose of a robot's root, a link, an object or the world, seen from another of these."""
        pose = _seen(base, robots, objects, said[:2]) if len(said) == 3 else None
        component = said[2].value if len(said) == 3 and isinstance(said[2], Literal) else ""
        if pose is None or component not in COMPONENTS:
            return None
        return number((*pose.position_m, *pose.orientation_xyzw)[COMPONENTS.index(component)])

    def distance(*said: Term) -> Term | None:
        """Between the origins of two of these (m)."""
        pose = _seen(base, robots, objects, said) if len(said) == 2 else None
        return None if pose is None else number(rounded(math.hypot(*pose.position_m)))

    return {LF.canReach: can_reach, LF.poseIn: pose_in, LF.distance: distance}


def _seen(base: str, robots: Mapping[str, Robot], objects: Mapping[str, Placed], said: Collection[Term]) -> Pose | None:
    """The pose of the first as the second sees it; None while it is unknown, and for what has none."""
    paths = [_path(base, each) for each in said]
    try:
        return seen_from(paths[0], paths[1], robots, objects).pose
    except LookupError:
        return None


def _path(base: str, term: Term) -> str:
    """Empty for what is not of this fleet."""
    named = isinstance(term, NamedNode) and term.value.startswith(base + "/")
    return term.value[len(base) :] if named else ""  # type: ignore[union-attr]


def _link(base: str, robots: Mapping[str, Robot], term: Term) -> tuple[Robot, str] | None:
    head, _, part = _path(base, term)[1:].partition("/")
    try:
        robot = robots[robot_name(head)]
        link = None if robot.model is None else part_of(part, robot.model)[1]
    except (KeyError, ValueError):
        return None
    return None if link is None else (robot, link)


def _metres(term: Term) -> float | None:
    try:
        value = float(term.value) if isinstance(term, Literal) else math.nan
    except ValueError:
        return None
    return value if math.isfinite(value) else None


def _reaches(robot: Robot, link: str, place: Vector) -> bool | None:
    description, frame, able = robot.description, robot.frame, commandable(robot)
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
        # Raised again: but the store takes whatever is raised for an error of the expression, and tells nobody.
        log.exception("lf:canReach failed")
        raise
    return True


def _beyond(robot: Robot, link: str, movable: Collection[str], place: Vector) -> bool:
    """Return True if the robot is too short to reach the point, whatever its joints do."""
    assert robot.model is not None and robot.description is not None and robot.frame is not None
    root = placed(robot.frame.base) if robot.description.base == "floating" else ORIGIN
    if root is None:
        return False
    at = compose(inverse(root), Pose(place, ORIGIN.orientation_xyzw)).position_m
    return not envelope(robot.model, link, movable).contains(at, TOLERANCE_M)
