"""The terms of saved poses."""

from linked_fleet_gateway.api import DCTERMS
from linked_fleet_gateway.api import LF as CORE

LF = CORE.extended("PoseList SavedPose PoseInput PoseListShape SavedPoseShape JointGroup savedPoses savedBy jointGroup")
MODIFIED = DCTERMS.extended("modified").modified
