"""Types that no distribution and no folder has: nodes are asked to describe them (REP 2016)."""

import asyncio
import logging
from collections.abc import Mapping, Sequence
from typing import Any

from linked_fleet_agent.robots.ros2.definitions import DefinitionError
from linked_fleet_agent.robots.ros2.graph import CallError, Graph, Interface
from linked_fleet_agent.robots.ros2.serialization import CdrError
from linked_fleet_agent.robots.ros2.types import GET_TYPE_DESCRIPTION, MAX_DESCRIPTION_BYTES, MessageTypes

_log = logging.getLogger(__name__)

ANSWER_S, MOST_NODES = 2.0, 16
"""Longest wait for a description, and the most nodes that are asked for one."""


async def describe(graph: Graph, types: MessageTypes, name: str, near: str, hashes: Mapping[str, str]) -> None:
    """Let nodes describe a type, or the parts of an action, as their ``hashes`` say. ``near`` is a name that has it.

    Raises DefinitionError if none does. Nodes whose names resemble ``near`` are asked first.
    """
    service = types.service(GET_TYPE_DESCRIPTION)
    nodes = sorted(
        (each.interface for each in graph.offers() if each.role == "service" and each.interface.type == service.name),
        key=lambda node: -_shared(node.name, near),
    )[:MOST_NODES]
    if not hashes or not nodes:
        why = "no node describes types" if hashes else "its peers do not state a hash, so no node can describe it"
        raise DefinitionError(f"the type {name} is not known: {why}. Name a folder with its definition by 'types'")
    described = [await _described(graph, types, nodes, part, hash) for part, hash in hashes.items()]
    if name not in hashes:
        types.describe_action(name, described)


async def _described(
    graph: Graph, types: MessageTypes, nodes: Sequence[Interface], name: str, hash: str
) -> Mapping[str, Any]:
    service = types.service(GET_TYPE_DESCRIPTION)
    request = service.request.write({"type_name": name, "type_hash": hash, "include_type_sources": False})
    why = ""
    for node in nodes:
        try:
            async with asyncio.timeout(ANSWER_S):
                answer = service.response.read(
                    await graph.call(node, request, MAX_DESCRIPTION_BYTES), MAX_DESCRIPTION_BYTES
                )
            description: Mapping[str, Any] = answer["type_description"]
            if answer["successful"] and types.describe(description, hash).name == name:
                return description
            why = f"{node.name} answers: {answer['failure_reason'][:200] or 'it is not known'}"
        except (TimeoutError, CallError, CdrError, DefinitionError) as error:
            why = f"{node.name}: {str(error)[:200] or 'no answer'}"
        _log.info("%s is not described: %s", name, why)
    raise DefinitionError(f"the type {name} is not known, and none of {len(nodes)} nodes describes it ({why})")


def _shared(one: str, other: str) -> int:
    """Return how many leading parts two names share."""
    parts = zip(one.split("/"), other.split("/"), strict=False)
    return next((index for index, (a, b) in enumerate(parts) if a != b), min(one.count("/"), other.count("/")))
