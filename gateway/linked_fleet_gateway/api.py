"""The contract of extensions: the names of the gateway that most extensions need (docs/EXTENDING.md).

Extensions of other packages import this module, ``faces``, ``serving``, ``linked_fleet_gateway.extensions.pages.api``,
``linked_fleet_gateway.extensions.openapi.api``, and the extensions that they need. Names outside of these may change
at any time. ``VERSION`` counts changes that break extensions.
"""

from pyoxigraph import Literal, NamedNode
from starlette.responses import Response

from linked_fleet_agent.wire.messages import Follow, Move
from linked_fleet_base.errors import (
    BadRequest,
    Busy,
    Conflict,
    FleetError,
    NotFound,
    PreconditionFailed,
    RedisUnavailable,
    UnprocessableContent,
)
from linked_fleet_base.settings import ON_OFF, TEXT, Section, setting, whole_number
from linked_fleet_gateway.actions.action_handlers import build_motion
from linked_fleet_gateway.actions.guards import MotionGuard
from linked_fleet_gateway.actions.operations import Call, Operation
from linked_fleet_gateway.actions.plan import ActionRequest, DeferredPlan, Halt, Motion
from linked_fleet_gateway.http.body import body_type
from linked_fleet_gateway.http.content import Content
from linked_fleet_gateway.http.entrance import await_turn
from linked_fleet_gateway.http.extension import Core, Extension, Mount
from linked_fleet_gateway.http.hosted import AsgiResponse
from linked_fleet_gateway.http.internal_request import ask
from linked_fleet_gateway.http.negotiation import choose
from linked_fleet_gateway.http.read import read_resource
from linked_fleet_gateway.http.request import Request, WebSocket
from linked_fleet_gateway.http.request_events import RequestEvent
from linked_fleet_gateway.http.websocket import SubprotocolConnection, WebSocketHandler
from linked_fleet_gateway.resources.affordance import Demand
from linked_fleet_gateway.resources.body_values import Body
from linked_fleet_gateway.resources.branches import FleetBranch, Found, PropertyBranch, RequestView, RobotBranch
from linked_fleet_gateway.resources.container import Container, Member
from linked_fleet_gateway.resources.description import InSteps
from linked_fleet_gateway.resources.html import NavigationEntry
from linked_fleet_gateway.resources.paths import joint_path, link_path, robot_of, robot_path, thing_at
from linked_fleet_gateway.resources.property import Property
from linked_fleet_gateway.resources.resource import CONTAINER, Resource, blueprint_of
from linked_fleet_gateway.resources.versioning import Source
from linked_fleet_identity.rights import Right
from linked_fleet_rdf.graph import METRE, RADIAN, SECOND, UNITLESS, Graph, integer, timestamp
from linked_fleet_rdf.vocabulary import DCTERMS, LDP, LF, RDF, RDFS
from linked_fleet_runtime.background import cancel_tasks, supervised, time_sliced
from linked_fleet_runtime.metrics import counter, gauge, gauges
from linked_fleet_runtime.table import Table
from linked_fleet_shacl.terms import Namespace
from linked_fleet_state.invocation import Invocation, InvocationState
from linked_fleet_state.model import Joint, Link, Pose, RobotModel
from linked_fleet_state.robot import KeptPose, Robot

VERSION = 1

__all__ = [
    "CONTAINER", "DCTERMS", "LDP", "LF", "METRE", "ON_OFF", "RADIAN", "RDF", "RDFS", "SECOND", "TEXT", "UNITLESS",
    "VERSION", "ActionRequest", "AsgiResponse", "BadRequest", "Body", "Busy", "Call", "Conflict", "Container",
    "Content", "Core", "DeferredPlan", "Demand", "Extension", "FleetBranch", "FleetError", "Follow", "Found", "Graph",
    "Halt", "InSteps", "Invocation", "InvocationState", "Joint", "KeptPose", "Link", "Literal", "Member", "Motion",
    "MotionGuard", "Mount", "Move", "NamedNode", "Namespace", "NavigationEntry", "NotFound", "Operation", "Pose",
    "PreconditionFailed", "Property", "PropertyBranch", "RedisUnavailable", "Request", "RequestEvent", "RequestView",
    "Resource", "Response", "Right", "Robot", "RobotBranch", "RobotModel", "Section", "Source",
    "SubprotocolConnection", "Table", "UnprocessableContent", "WebSocket", "WebSocketHandler", "ask", "await_turn",
    "blueprint_of", "body_type", "build_motion", "cancel_tasks", "choose", "counter", "gauge", "gauges", "integer",
    "joint_path", "link_path", "read_resource", "robot_of", "robot_path", "setting", "supervised", "thing_at",
    "time_sliced", "timestamp", "whole_number",
]  # fmt: skip
