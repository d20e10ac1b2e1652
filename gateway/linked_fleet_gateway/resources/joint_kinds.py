"""The table of joint kinds: class, shape, predicate, path segment, units, resolution."""

from dataclasses import dataclass

from pyoxigraph import NamedNode

from linked_fleet_rdf.graph import ANGULAR, LINEAR, Dimension
from linked_fleet_rdf.vocabulary import LF, ROS
from linked_fleet_state.model import Joint, JointKind

# Resolutions of change detection (docs/TREE.md): a value that moved by less counts as the same.
POSITION_RESOLUTION = 1e-5  # rad or m
VELOCITY_RESOLUTION = 1e-3  # rad/s or m/s
EFFORT_RESOLUTION = 1e-2  # N m or N
POSE_RESOLUTION = 1e-5  # m, and per component of a unit quaternion


@dataclass(frozen=True)
class Kind:
    """A row of the table; ``position`` is the path segment of the joint's position."""

    type: NamedNode
    shape: NamedNode
    dimension: Dimension | None = None
    position: str | None = None
    predicate: NamedNode | None = None


KINDS: dict[JointKind, Kind] = {
    JointKind.REVOLUTE: Kind(ROS.RevoluteJoint, ROS.RevoluteJointShape, ANGULAR, "rotation", ROS.rotation),
    JointKind.CONTINUOUS: Kind(LF.ContinuousJoint, LF.ContinuousJointShape, ANGULAR, "rotation", ROS.rotation),
    JointKind.PRISMATIC: Kind(LF.PrismaticJoint, LF.PrismaticJointShape, LINEAR, "translation", LF.translation),
    JointKind.FIXED: Kind(LF.FixedJoint, LF.FixedJointShape),
    JointKind.FLOATING: Kind(LF.FloatingJoint, LF.FloatingJointShape),
    JointKind.PLANAR: Kind(LF.PlanarJoint, LF.PlanarJointShape),
}


def kind_of(joint: Joint) -> Kind:
    """Return the classes, dimension and position property of joints of this kind."""
    return KINDS[joint.kind]
