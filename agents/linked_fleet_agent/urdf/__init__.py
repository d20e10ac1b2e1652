"""The one reader of robot descriptions (URDF), for agents, drivers, the gateway and all that these pass it on to.

``RobotModel.parse`` returns a model or raises UrdfError with a sentence; ``plain_urdf`` writes a model for other
readers. The package needs the standard library only.
"""

from linked_fleet_agent.urdf.document import UrdfError, decode, parse
from linked_fleet_agent.urdf.facts import JointFacts, joints_of
from linked_fleet_agent.urdf.model import RobotModel
from linked_fleet_agent.urdf.xml import XmlError, XmlReader

__all__ = ["JointFacts", "RobotModel", "UrdfError", "XmlError", "XmlReader", "decode", "joints_of", "parse"]
