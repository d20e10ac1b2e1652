"""The tool ``find``: searches robots, joints, links and actions by name, and tells how to call them."""

import json
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from itertools import islice
from typing import Any, Literal

from mcp_types import CallToolResult, TextContent
from pydantic import Field

from linked_fleet_gateway.extensions.mcp.message_context import MessageContext
from linked_fleet_gateway.extensions.mcp.tool import Progress, Tool
from linked_fleet_gateway.fleet.model import Joint
from linked_fleet_gateway.fleet.robot import Robot
from linked_fleet_gateway.resources.action_offer import Offer, fleet_offers, joint_offers, robot_offers
from linked_fleet_gateway.resources.affordance import Invoke
from linked_fleet_gateway.resources.joint_kinds import kind_of
from linked_fleet_gateway.resources.json_form import form_of_input
from linked_fleet_gateway.resources.paths import joint_path, link_path, robot_path
from linked_fleet_gateway.resources.properties import joint_properties
from linked_fleet_gateway.runtime.background import sliced


@dataclass(frozen=True)
class Found:
    """A search result. ``tell`` computes its details, only if the result is returned."""

    kind: str
    path: str
    title: str
    words: str
    tell: Callable[[], dict[str, Any]] = dict

    def has(self, words: list[str]) -> bool:
        text = f"{self.path} {self.title} {self.words}".casefold()
        return all(each in text for each in words)


class Find(Tool):
    """Find robots, joints, links and actions by words, kind and robot. An action comes with the JSON Schema of its
    body, in which the limits of the joint at hand stand."""

    text: str = Field("", max_length=200, description="words that name, title or description have; all of them")
    kind: Literal["robot", "joint", "link", "action", "any"] = "any"
    robot: str = Field("", max_length=200, description="name of the one robot to look at")
    limit: int = Field(20, ge=1, le=50, description="the most that is told")

    async def run(self, context: MessageContext, progress: Progress) -> CallToolResult:
        words, matching = self.text.casefold().split(), list[Found]()
        async for each in sliced(_all(context, self.robot)):
            if self.kind in ("any", each.kind) and each.has(words):
                matching.append(each)
                if len(matching) > self.limit:
                    break
        items = []
        async for each in sliced(islice(matching, self.limit)):
            items.append({"kind": each.kind, "iri": context.view.base + each.path, "title": each.title, **each.tell()})
        value = {"items": items, "more": len(matching) > self.limit}
        return CallToolResult(content=[TextContent(text=json.dumps(value))], structured_content=value)


def _all(context: MessageContext, name: str) -> Iterator[Found]:
    """Yield robots before their parts, so that the first results lead to the rest."""
    robots = [robot for key, robot in sorted(context.view.robots.items()) if name in ("", key)]
    for robot in robots:
        presence = {"name": robot.name, "online": robot.online, "fault": robot.fault}
        yield Found("robot", robot_path(robot.name), robot.title, robot.name, presence.copy)
    if not name:
        yield from _actions(context, fleet_offers())
    for robot in robots:
        yield from _actions(context, robot_offers(robot))
        yield from _parts(context, robot)


def _parts(context: MessageContext, robot: Robot) -> Iterator[Found]:
    if robot.model is None:
        return
    for joint in robot.model.joints.values():
        path, kind = joint_path(robot.name, joint.name), kind_of(joint).type.value.rpartition("#")[2]
        tell = partial(_values, context, robot, joint, kind)
        yield Found("joint", path, f"{joint.name} of {robot.title}", f"{robot.name} {kind}", tell)
        yield from _actions(context, joint_offers(robot, joint))
    for link in robot.model.links.values():
        yield Found("link", link_path(robot.name, robot.model, link.name), f"{link.name} of {robot.title}", robot.name)


def _values(context: MessageContext, robot: Robot, joint: Joint, kind: str) -> dict[str, Any]:
    iri = context.view.base + joint_path(robot.name, joint.name)
    return {"type": kind, "values": [f"{iri}/{each.segment}" for each in joint_properties(robot, joint)]}


def _actions(context: MessageContext, offers: list[Offer]) -> Iterator[Found]:
    """Yield the actions that the caller may invoke."""
    for offer in offers:
        if context.request.caller.may_any(Invoke(offer).needs, offer.robot.name if offer.robot else None):
            yield Found("action", offer.path, offer.name, offer.definition.comment, partial(_call, context, offer))


def _call(context: MessageContext, offer: Offer) -> dict[str, Any]:
    said = {"description": offer.definition.comment}
    if not offer.takes_body:
        return {**said, "call": {"tool": "stop", "arguments": {"target": context.view.base + offer.path}}}
    return {**said, "call": {"tool": "act"}, "body_schema": form_of_input(offer, context.view.base).schema}
