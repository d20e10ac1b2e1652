"""Numbers of URDF for the gateway: those of the one reader of descriptions, ``linked_fleet_agent.urdf``."""

from linked_fleet_agent.urdf.document import UrdfError as ModelError
from linked_fleet_agent.urdf.document import parse as parse_xml
from linked_fleet_agent.urdf.poses import Quaternion, quaternion, rotation
from linked_fleet_agent.urdf.values import Vector

__all__ = ["ModelError", "Quaternion", "Vector", "parse_xml", "quaternion", "rotation"]
