"""The joints and links of a robot, as returned by the one reader of descriptions, ``linked_fleet_agent.urdf``."""

from linked_fleet_agent.urdf.document import UrdfError as ModelError
from linked_fleet_agent.urdf.inertials import Inertial
from linked_fleet_agent.urdf.joints import Joint, JointKind, Mimic
from linked_fleet_agent.urdf.limits import Limits
from linked_fleet_agent.urdf.model import Link, RobotModel
from linked_fleet_agent.urdf.poses import Pose

__all__ = ["Inertial", "Joint", "JointKind", "Limits", "Link", "Mimic", "ModelError", "Pose", "RobotModel"]
