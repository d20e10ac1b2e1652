"""The contract of faces: names by which an extension shows the whole tree in another form (docs/EXTENDING.md).

A face is, for example, a description language, a protocol, a query language or a page. The module is pure: worker
processes that import it load neither HTTP nor Zenoh, so it has some names of ``linked_fleet_gateway.api`` too.
``VERSION`` counts changes that break extensions.
"""

from linked_fleet_gateway.resources.action_offer import (
    ActionDefinition,
    Offer,
    action_definitions,
    offers_at,
    path_offer,
)
from linked_fleet_gateway.resources.affordance import Invoke
from linked_fleet_gateway.resources.annotations import named_poses, pose_finding
from linked_fleet_gateway.resources.body_values import Body, Setting, managed_statements, validate_body
from linked_fleet_gateway.resources.branches import ThingDocument
from linked_fleet_gateway.resources.describe import Describer, last_frame, part_paths
from linked_fleet_gateway.resources.description import DescriptionTemplate, Rows, lexical_time, run_steps
from linked_fleet_gateway.resources.documents import VOCABULARY, describe_terms
from linked_fleet_gateway.resources.form import DeclaredForm, Form, Json
from linked_fleet_gateway.resources.html import HTML, NavigationEntry, PageContext, Reader
from linked_fleet_gateway.resources.invocation import (
    describe_invocation,
    describe_lease,
    invocation_path,
    unchecked_links,
)
from linked_fleet_gateway.resources.joint_kinds import kind_of
from linked_fleet_gateway.resources.json_form import (
    form_in,
    form_of,
    form_of_input,
    form_of_target,
)
from linked_fleet_gateway.resources.part import PartCopier, RobotPart, drive_limits, parts_of, path_ahead
from linked_fleet_gateway.resources.paths import (
    joint_path,
    lease_path,
    link_path,
    part_path,
    robot_of,
    robot_path,
    thing_at,
)
from linked_fleet_gateway.resources.properties import properties_at
from linked_fleet_gateway.resources.property import Measurement, Property
from linked_fleet_gateway.resources.relative_poses import RelativePose, relative_pose, round_to_resolution
from linked_fleet_gateway.resources.resource import Resource
from linked_fleet_gateway.resources.shape_parameters import commandable_joints
from linked_fleet_gateway.resources.subscription_resource import describe_request_shape
from linked_fleet_gateway.resources.tree import Tree
from linked_fleet_gateway.resources.versioning import Reading
from linked_fleet_identity.rights import ALL, EVERYBODY, Claims, Credential, Identity, Right, TokenHash, View

VERSION = 1

__all__ = [
    "ALL", "EVERYBODY", "HTML", "VERSION", "VOCABULARY", "ActionDefinition", "Body", "Claims", "Credential",
    "DeclaredForm", "Describer", "DescriptionTemplate", "Form", "Identity", "Invoke", "Json", "Measurement",
    "NavigationEntry", "Offer", "PageContext", "PartCopier", "Property", "Reader", "Reading", "RelativePose",
    "Resource", "Right", "RobotPart", "Rows", "Setting", "ThingDocument", "TokenHash", "Tree", "View",
    "action_definitions", "commandable_joints", "describe_invocation", "describe_lease", "describe_request_shape",
    "describe_terms", "drive_limits", "form_in", "form_of", "form_of_input", "form_of_target", "invocation_path",
    "joint_path", "kind_of", "last_frame", "lease_path", "lexical_time", "link_path", "managed_statements",
    "named_poses", "offers_at", "part_path", "part_paths", "parts_of", "path_ahead", "path_offer", "pose_finding",
    "properties_at",
    "relative_pose", "robot_of", "robot_path", "round_to_resolution", "run_steps", "thing_at", "unchecked_links",
    "validate_body",
]  # fmt: skip
