"""The query functions ``lf:poseIn`` and ``lf:distance``, and the terms of the extension."""

import math
from collections.abc import Collection, Mapping

from pyoxigraph import Literal, NamedNode

from linked_fleet_gateway.faces import relative_pose, round_to_resolution
from linked_fleet_rdf.graph import number
from linked_fleet_rdf.vocabulary import LF as CORE
from linked_fleet_state.carried import CarriedPose
from linked_fleet_state.functions import Function, Term, path_of
from linked_fleet_state.model import Pose
from linked_fleet_state.robot import Robot

LF = CORE.extended("query poseIn distance example")

FUNCTIONS = (LF.poseIn, LF.distance)
COMPONENTS = ("x", "y", "z", "qx", "qy", "qz", "qw")
"""The components of a pose: position (m) and unit quaternion."""


Common = Mapping[str, Pose | CarriedPose]
"""Poses of things besides robots in the common frame, or on links of robots, by path."""


def functions_of(base: str, robots: Mapping[str, Robot], common: Common) -> dict[NamedNode, Function]:
    """Return the functions for these robots and the poses of other things.

    They return None for an expression error.
    """

    def pose_in(*said: Term) -> Term | None:
        """Return one component of the pose of a robot's root, a link or another thing, relative to another of these."""
        pose = _seen(base, robots, common, said[:2]) if len(said) == 3 else None
        component = said[2].value if len(said) == 3 and isinstance(said[2], Literal) else ""
        if pose is None or component not in COMPONENTS:
            return None
        return number((*pose.position_m, *pose.orientation_xyzw)[COMPONENTS.index(component)])

    def distance(*said: Term) -> Term | None:
        """Return the distance between the origins of two of these (m)."""
        pose = _seen(base, robots, common, said) if len(said) == 2 else None
        return None if pose is None else number(round_to_resolution(math.hypot(*pose.position_m)))

    return {LF.poseIn: pose_in, LF.distance: distance}


def _seen(base: str, robots: Mapping[str, Robot], common: Common, said: Collection[Term]) -> Pose | None:
    """Return the pose of the first relative to the second; None if it is unknown or does not exist."""
    paths = [path_of(base, each) for each in said]
    try:
        return relative_pose(paths[0], paths[1], robots, common).pose
    except LookupError:
        return None
