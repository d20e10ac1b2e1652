"""What queries can call beside SPARQL's own functions: ``lf:canReach(?link, x, y, z)``."""

import logging
import math
from collections.abc import Callable, Mapping
from importlib import import_module
from typing import TYPE_CHECKING

from pyoxigraph import BlankNode, Literal, NamedNode, Triple

from agents.wire.messages import Base
from gateway.actions.completions import commandable
from gateway.fleet.model import JointKind, ModelError
from gateway.fleet.robot import Robot
from gateway.graph.paths import part_of, robot_name
from gateway.graph.vocab import LF
from gateway.lazily import Lazily
from gateway.query.messages import Ask

TOLERANCE_M = 5e-5
_SOLVER = "gateway.fleet.reach"
if TYPE_CHECKING:
    from gateway.fleet import reach as solver
else:
    solver = Lazily(_SOLVER, "pinocchio", "numpy")

log = logging.getLogger(__name__)

Term = NamedNode | BlankNode | Literal | Triple


def prepare(ask: Ask) -> None:
    """Load what the query will need: afterwards no file can be opened."""
    if LF.canReach.value.rpartition("#")[2] in ask.query:
        import_module(_SOLVER)
        import_module("numpy.random")  # which numpy imports when it is first used


def functions_of(base: str, robots: Mapping[str, Robot]) -> dict[NamedNode, Callable[..., Literal | None]]:
    """The functions, for these robots and no others."""
    known: dict[tuple[str, tuple[float, ...]], bool] = {}

    def can_reach(*said: Term) -> Literal | None:
        """Whether joints within their limits bring the origin of a link there (m): in the frame of the robot's root
        link, in the world if its base floats. Not whether anything is in the way. An error where that is unknown."""
        found = _link(base, robots, said[0]) if len(said) == 4 else None
        place = tuple(map(_metres, said[1:]))
        if found is None or any(each is None for each in place):
            return None
        assert isinstance(said[0], NamedNode)
        key = said[0].value, tuple(float(each) for each in place if each is not None)
        if key not in known:
            answer = _reaches(*found, key[1])
            if answer is None:
                return None
            known[key] = answer
        return Literal(known[key])

    return {LF.canReach: can_reach}


def _link(base: str, robots: Mapping[str, Robot], term: Term) -> tuple[Robot, str] | None:
    if not isinstance(term, NamedNode) or not term.value.startswith(base + "/"):
        return None
    head, _, part = term.value[len(base) + 1 :].partition("/")
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


def _reaches(robot: Robot, link: str, place: tuple[float, ...]) -> bool | None:
    description, frame = robot.description, robot.frame
    if description is None or frame is None:
        return None
    able, (x, y, z) = commandable(robot), place
    limits = {
        joint.name: (joint.limits.lower, joint.limits.upper)
        for joint in able
        if joint.kind is not JointKind.CONTINUOUS and joint.limits.lower is not None and joint.limits.upper is not None
    }
    if _beyond(robot, link, frame.base, place):
        return False
    floating, movable = description.base == "floating", [joint.name for joint in able]
    try:
        solver.reach(
            description.urdf, floating, link, (x, y, z), None, dict(robot.positions), limits, movable, frame.base,
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


def _beyond(robot: Robot, link: str, base: Base | None, place: tuple[float, ...]) -> bool:
    """Whether the robot is too short for it, whatever its joints do: a search that fails takes half a second."""
    model, length = robot.model, 0.0
    assert model is not None
    while (parent := model.links[link].parent_joint) is not None:
        joint = model.joints[parent]
        ends = (joint.limits.lower, joint.limits.upper) if joint.kind is JointKind.PRISMATIC else (0.0, 0.0)
        length += math.hypot(*joint.origin.position_m) + max(math.inf if end is None else abs(end) for end in ends)
        link = joint.parent
    root = (0.0, 0.0, 0.0) if base is None else base.position_m
    return math.dist(root, place) > length + TOLERANCE_M
