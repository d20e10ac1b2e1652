"""The contract of serving: names by which an extension answers requests in its own way (docs/EXTENDING.md).

They are for own forms of bodies, preconditions, protocols and logins, and for what goes on beside requests: processes,
tables of an own form, and invocations for a client. ``VERSION`` counts changes that break extensions.
"""

from linked_fleet_gateway.actions.guards import MotionPlanner, Paths
from linked_fleet_gateway.actions.plan import Act, Caller, RobotTime, robot_time
from linked_fleet_gateway.http.arrival import Authenticated, arrival_of
from linked_fleet_gateway.http.body import convert_body, parse_body, parse_form, read_body
from linked_fleet_gateway.http.fields import Link as WebLink
from linked_fleet_gateway.http.fields import link_header
from linked_fleet_gateway.http.internal_request import Reply, ReplyTooLong
from linked_fleet_gateway.http.lease_tokens import websocket_caller
from linked_fleet_gateway.http.preconditions import (
    await_preconditions,
    check_preconditions,
    resolve_under_preconditions,
)
from linked_fleet_gateway.http.problem import problem
from linked_fleet_gateway.http.representation import not_modified
from linked_fleet_gateway.http.scheduling import TokenBuckets, stop_segments
from linked_fleet_gateway.http.streams import wants_events
from linked_fleet_gateway.http.websocket import ConnectionEnded, frame
from linked_fleet_gateway.http.writes import check_acceptable, created_response, patch_types, read_change
from linked_fleet_gateway.resources.resource import Rendition
from linked_fleet_gateway.subscriptions.live import Live
from linked_fleet_identity.issuers import BadToken, IssuerFailed
from linked_fleet_identity.roster import Issuer
from linked_fleet_identity.service import Identities
from linked_fleet_link.fleet_link import NoAnswer
from linked_fleet_runtime.background import run_last_step
from linked_fleet_runtime.questions import NoReply, QuestionProcess
from linked_fleet_runtime.redis import Connection as RedisConnection
from linked_fleet_runtime.replica import Replica
from linked_fleet_runtime.table import StoredRecords
from linked_fleet_runtime.worker import Worker

VERSION = 1

__all__ = [
    "VERSION", "Act", "Authenticated", "BadToken", "Caller", "ConnectionEnded", "Identities", "Issuer", "IssuerFailed",
    "Live", "MotionPlanner", "NoAnswer", "NoReply", "Paths", "QuestionProcess", "RedisConnection", "Rendition",
    "Replica", "Reply", "ReplyTooLong", "RobotTime", "StoredRecords", "TokenBuckets", "WebLink", "Worker",
    "arrival_of", "await_preconditions", "check_acceptable", "check_preconditions", "convert_body", "created_response",
    "frame", "link_header", "not_modified", "parse_body", "parse_form", "patch_types", "problem", "read_body",
    "read_change", "resolve_under_preconditions", "robot_time", "run_last_step", "stop_segments", "wants_events",
    "websocket_caller",
]  # fmt: skip
