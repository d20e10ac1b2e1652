"""Requests for control: somebody asks who has control of a robot to hand it over. Pure."""

import re
from typing import Literal
from urllib.parse import urlsplit

from msgspec import Struct
from msgspec.structs import replace

from linked_fleet_gateway.api import (
    Body,
    Graph,
    Member,
    NamedNode,
    UnprocessableContent,
    robot_of,
    robot_path,
    timestamp,
)
from linked_fleet_gateway.api import Literal as Text
from linked_fleet_gateway.extensions.people.terms import LF

ASK_S = 120.0
"""Time after which a request that nobody has answered ends."""
TOLD_S = 30.0
"""Time for which an answered request is there, so that its client hears of the answer."""
_TOKEN = re.compile(r"urn:uuid:[0-9a-f]{8}(-[0-9a-f]{4}){3}-[0-9a-f]{12}", re.ASCII)
_STATES = {"asked": LF.controlAsked, "granted": LF.controlGranted, "refused": LF.controlRefused}


class ControlRequest(Struct, frozen=True):
    """A request. Times are wall nanoseconds.

    ``token`` proves control once it is granted; a hash of it is kept. ``by`` names who asks, ``client`` is the name by
    which requests of one are known. ``may_be_person``: whether the asker may have the priority of a person.
    """

    robot: str
    token: str
    iri: str = ""
    by: str = ""
    client: str = ""
    may_be_person: bool = False
    asked_ns: int = 0
    ends_ns: int = 0
    state: Literal["asked", "granted", "refused"] = "asked"
    answered_by: str = ""

    def answered(self, state: Literal["granted", "refused"], by: str, now_ns: int) -> "ControlRequest":
        return replace(self, state=state, answered_by=by, ends_ns=now_ns + int(TOLD_S * 1e9))


def read_request(body: Body) -> ControlRequest:
    """Return what a body asks for. Raises UnprocessableContent."""
    robot, token = body.node(body.root, LF.ofRobot), body.text(body.root, LF.controlToken) or ""
    if not _TOKEN.fullmatch(token):
        raise UnprocessableContent(
            "controlToken is a random UUID of yours as a URN, urn:uuid:…, which proves your control later."
        )
    iri = robot.value if isinstance(robot, NamedNode) else ""
    name = robot_of(urlsplit(iri).path)
    if name is None:
        raise UnprocessableContent(f"ofRobot is the address of a robot, not {iri[:100]!r}.")
    return ControlRequest(name, token, iri)


def describe_request(graph: Graph, member: Member[ControlRequest]) -> None:
    record, iri = member.record, member.iri
    graph.add(iri, LF.ofRobot, NamedNode(member.view.base + robot_path(record.robot)))
    graph.add(iri, LF.asker, Text(record.by))
    graph.add(iri, LF.state, _STATES[record.state])
    graph.add(iri, LF.askingSince, timestamp(record.asked_ns))
    graph.add(iri, LF.expires, timestamp(record.ends_ns))
    if record.answered_by:
        graph.add(iri, LF.answeredBy, Text(record.answered_by))
