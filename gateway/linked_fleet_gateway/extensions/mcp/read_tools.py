"""The tree as resources, and the tools that search and read it.

The tool ``find`` searches robots, joints, links, components and actions by name, and returns the schemas of actions.
"""

import json
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from itertools import chain
from typing import Any, Literal

import mcp_types as types
from mcp.shared.exceptions import MCPError
from mcp_types import CallToolResult, TextContent
from pydantic import Field

from linked_fleet_base.errors import FleetError
from linked_fleet_gateway.api import Container, joint_path, link_path, robot_of, robot_path, time_sliced
from linked_fleet_gateway.extensions.mcp.message_context import MessageContext
from linked_fleet_gateway.extensions.mcp.tool import Progress, Target, Tool, content_result, is_text
from linked_fleet_gateway.faces import (
    Invoke,
    Offer,
    RobotPart,
    form_of_input,
    kind_of,
    offers_at,
    parts_of,
    properties_at,
)
from linked_fleet_gateway.serving import ReplyTooLong
from linked_fleet_state.model import Joint
from linked_fleet_state.robot import Robot

_JSONLD, _TURTLE = "application/ld+json", "text/turtle"
_ACCEPT = {
    "json": f"application/json, {_JSONLD};q=0.9, {_TURTLE};q=0.8, image/*;q=0.7, */*;q=0.1",
    "jsonld": f"{_JSONLD}, */*;q=0.1",
    "turtle": f"{_TURTLE}, */*;q=0.1",
}


class Read(Tool):
    """Read a resource of the fleet: a value, a joint, a robot, an invocation, a picture."""

    target: Target = Field(description="IRI or path of a resource, such as /")
    format: Literal["json", "jsonld", "turtle"] = Field(
        "json", description="json: plain values where there are any, else JSON-LD"
    )

    async def run(self, context: MessageContext, progress: Progress) -> types.CallToolResult:
        return content_result(await context.ask("GET", self.target, _ACCEPT[self.format]))


class Query(Tool):
    """Query the whole fleet in SPARQL 1.1, on a consistent snapshot."""

    query: str = Field(min_length=1, max_length=16_384)

    async def run(self, context: MessageContext, progress: Progress) -> types.CallToolResult:
        accept = f"application/sparql-results+json, {_TURTLE};q=0.9"
        fields = {"content-type": "application/sparql-query"}
        return content_result(await context.ask("POST", "/query", accept, fields, self.query.encode()))


def resources(context: MessageContext) -> list[types.Resource]:
    """Return the fleet and its robots; links lead to the rest."""
    named = [("fleet", "Linked Fleet", "/")]
    named += [(name, robot.title, robot_path(name)) for name, robot in sorted(context.view.robots.items())]
    return [
        types.Resource(name=name, title=title, uri=context.view.base + path, mime_type=_JSONLD)
        for name, title, path in named
    ]


def templates(context: MessageContext) -> list[types.ResourceTemplate]:
    uri, about = context.view.base + "/{+path}", "a path of the tree, such as {robot}/ or {robot}/{joint}"
    return [
        types.ResourceTemplate(name="resource", uri_template=uri, description=about, mime_type=_JSONLD),
        types.ResourceTemplate(name="turtle", uri_template=f"{uri}?as=turtle", description=about, mime_type=_TURTLE),
    ]


async def contents(context: MessageContext, uri: str) -> types.TextResourceContents:
    """Return the representation of a resource, JSON-LD unless the URI says otherwise. MCPError if it cannot be read."""
    try:
        reply = await context.ask("GET", uri, _ACCEPT["jsonld"])
    except (FleetError, ReplyTooLong) as error:
        raise MCPError(types.INVALID_PARAMS, str(error), {"uri": uri}) from error
    if reply.status != 200:
        problem = reply.problem
        raise MCPError(
            types.INVALID_PARAMS, f"{problem['title']}: {problem.get('detail', '')}", {"uri": uri, **problem}
        )
    if not is_text(kind := reply.media_type):
        raise MCPError(types.INVALID_PARAMS, f"This is {kind}; read it by HTTP.", {"uri": uri})
    return types.TextResourceContents(uri=uri, mime_type=kind, text=reply.content.decode())


@dataclass(frozen=True)
class SearchResult:
    """A search result. ``details`` computes its details, only if the result is returned."""

    kind: str
    path: str
    title: str
    words: str
    details: Callable[[], dict[str, Any]] = dict

    def matches(self, words: list[str]) -> bool:
        text = f"{self.path} {self.title} {self.words}".casefold()
        return all(each in text for each in words)


class Find(Tool):
    """Find robots, joints, links, components (grippers, switches and the like), containers (such as missions and their
    runs) with their members, and actions, by words, kind and robot. Actions have the JSON Schema of their body, with
    the limits of the joint, and containers that of their members."""

    text: str = Field("", max_length=200, description="words that must all occur in name, title or description")
    kind: Literal["robot", "joint", "link", "component", "container", "member", "action", "any"] = "any"
    robot: str = Field("", max_length=200, description="name of a robot, to search only that one")
    limit: int = Field(20, ge=1, le=50, description="maximum number of results")

    async def run(self, context: MessageContext, progress: Progress) -> CallToolResult:
        words, items, more = self.text.casefold().split(), list[dict[str, Any]](), False
        async for each in time_sliced(_all(context, self.robot)):
            if self.kind in ("any", each.kind) and each.matches(words):
                if len(items) == self.limit:
                    more = True
                    break
                items.append(_item(context, each))
        value = {"items": items, "more": more}
        return CallToolResult(content=[TextContent(text=json.dumps(value))], structured_content=value)


_SEARCH = "the search of MCP"


def _item(context: MessageContext, found: SearchResult) -> dict[str, Any]:
    """Return an item; its details are made at once, because the robot may change before the next step."""
    said = {"kind": found.kind, "iri": context.view.base + found.path, "title": found.title}
    robot = robot_of(found.path) or ""
    with context.view.faults.guard(_SEARCH, robot, found.path):
        return said | found.details()
    return said | {"fault": context.view.faults.find(_SEARCH, robot, found.path)}


def _all(context: MessageContext, name: str) -> Iterator[SearchResult]:
    """Yield robots before their parts, so that the first results lead to the rest."""
    robots = [robot for key, robot in sorted(context.view.robots.items()) if name in ("", key)]
    for robot in robots:
        presence = {"name": robot.name, "online": robot.online, "fault": robot.fault}
        yield SearchResult("robot", robot_path(robot.name), robot.title, robot.name, presence.copy)
    if not name:
        yield from _actions(context, offers_at(None))
    for robot in robots:
        with context.view.faults.guard(_SEARCH, robot.name):
            yield from _in_robot(context, robot)
        if reason := context.view.faults.find(_SEARCH, robot.name):
            told = {"name": robot.name, "fault": reason}
            yield SearchResult("robot", robot_path(robot.name), robot.title, robot.name, told.copy)
    if not name:
        for container in context.core.live.branches.containers:
            with context.view.faults.guard(_SEARCH, thing=container.path):
                yield from _in_container(context, container)


def _in_container(context: MessageContext, container: Container[Any]) -> Iterator[SearchResult]:
    """Yield a container, and its members with their actions, as far as the caller may read them."""
    caller = context.request.caller
    if not caller.has_any_right(container.reading, None):
        return
    told = partial(_writing, container) if container.by_clients else dict
    yield SearchResult("container", container.path, container.title, "", told)
    kind = container.member_type.value.rpartition("#")[2]
    for member in container.members(context.view):
        yield SearchResult("member", member.path, member.title, kind, partial(dict, type=kind))
        yield from _actions(context, member.offers())


def _writing(container: Container[Any]) -> dict[str, Any]:
    return {"call": {"tool": "write"}, "body_schema": container.form_at("").schema}


def _in_robot(context: MessageContext, robot: Robot) -> Iterator[SearchResult]:
    """Yield the actions and parts of a robot while it has this model."""
    model = robot.model
    for each in chain(_actions(context, offers_at(robot)), _parts(context, robot)):
        yield each
        if robot.model is not model:
            return


def _parts(context: MessageContext, robot: Robot) -> Iterator[SearchResult]:
    if robot.model is None:
        return
    for joint in robot.model.joints.values():
        path, kind = joint_path(robot.name, joint.name), kind_of(joint).type.value.rpartition("#")[2]
        tell = partial(_values, context, robot, joint, kind)
        yield SearchResult("joint", path, f"{joint.name} of {robot.title}", f"{robot.name} {kind}", tell)
        yield from _actions(context, offers_at(robot, joint))
    for link in robot.model.links.values():
        yield SearchResult(
            "link", link_path(robot.name, robot.model, link.name), f"{link.name} of {robot.title}", robot.name
        )
    for part in parts_of(robot).values():
        kinds = [each.value.rpartition("#")[2] for each in part.types]
        told, words = partial(_values_of_part, context, part, kinds), " ".join((robot.name, part.name, *kinds))
        yield SearchResult("component", part.path, f"{part.title} of {robot.title}", words, told)
        yield from _actions(context, offers_at(robot, part))


def _values(context: MessageContext, robot: Robot, joint: Joint, kind: str) -> dict[str, Any]:
    base = context.view.base
    iri = base + joint_path(robot.name, joint.name)
    return {"type": kind, "values": [f"{iri}/{each.segment}" for each in properties_at(base, robot, joint)]}


def _values_of_part(context: MessageContext, part: RobotPart, kinds: list[str]) -> dict[str, Any]:
    """Return the kinds of a part, its present values, and where each of them and of its events is."""
    iri = context.view.base + part.path
    resources = [f"{iri}/{each.segment}" for each in part.properties(context.view.base)]
    return {"types": kinds, "now": json.loads(part.json()), "values": resources}


def _actions(context: MessageContext, offers: list[Offer]) -> Iterator[SearchResult]:
    """Yield the actions that the caller may invoke."""
    for offer in offers:
        if context.request.caller.has_any_right(Invoke(offer).needs, offer.robot.name if offer.robot else None):
            yield SearchResult(
                "action", offer.path, offer.name, offer.definition.comment, partial(_call, context, offer)
            )


def _call(context: MessageContext, offer: Offer) -> dict[str, Any]:
    said = {"description": offer.definition.comment}
    if offer.is_stop:
        return {**said, "call": {"tool": "stop", "arguments": {"target": context.view.base + offer.path}}}
    body = {"body_schema": form_of_input(offer, context.view.base).schema} if offer.takes_body else {}
    return {**said, "call": {"tool": "act"}, **body}
