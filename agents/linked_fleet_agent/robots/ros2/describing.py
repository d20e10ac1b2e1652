"""Types that no distribution and no folder has: nodes are asked to describe them (REP 2016)."""

import asyncio
import logging
import time
from collections.abc import Mapping, Sequence
from typing import Any

from linked_fleet_agent.robots.ros2.definitions import DefinitionError
from linked_fleet_agent.robots.ros2.graph import CallError, Graph, Interface
from linked_fleet_agent.robots.ros2.serialization import CdrError
from linked_fleet_agent.robots.ros2.types import GET_TYPE_DESCRIPTION, MAX_DESCRIPTION_BYTES, MessageTypes

_log = logging.getLogger(__name__)

ANSWER_S, MOST_NODES, MOST_S = 2.0, 16, 20.0
"""Longest wait for a description, the most nodes that are asked for one, and the longest time for all types."""


class Describing:
    """Lets nodes describe types. One that has not answered in time is not asked again."""

    def __init__(self, graph: Graph, types: MessageTypes) -> None:
        self._graph, self._types, self._service = graph, types, types.service(GET_TYPE_DESCRIPTION)
        self._silent, self._spent_s = set[str](), 0.0

    async def describe(self, name: str, near: str, hashes: Mapping[str, str]) -> None:
        """Let nodes describe a type, or the parts of an action, as their ``hashes`` say.

        ``near`` is a name that has it: nodes whose names resemble it are asked first. Raises DefinitionError if none
        describes it.
        """
        nodes = self._nodes(near)
        if not hashes or not nodes:
            why = "no node describes types" if hashes else "its peers do not state a hash, so no node can describe it"
            raise DefinitionError(f"the type {name} is not known: {why}. Name a folder with its definition by 'types'")
        described = [await self._described(nodes, part, hash) for part, hash in hashes.items()]
        if name not in hashes:
            self._types.describe_action(name, described)

    def _nodes(self, near: str) -> list[Interface]:
        offered = (each.interface for each in self._graph.offers() if each.role == "service")
        found = {each for each in offered if each.type == self._service.name}
        return sorted(found, key=lambda node: (-_shared(node.name, near), node.name))[:MOST_NODES]

    async def _described(self, nodes: Sequence[Interface], name: str, hash: str) -> Mapping[str, Any]:
        request = {"type_name": name, "type_hash": hash, "include_type_sources": False}
        payload, why = self._service.request.write(request), "none of them answers"
        for node in nodes:
            if node.name in self._silent:
                continue
            try:
                answer = await self._ask(node, payload)
                description: Mapping[str, Any] = answer["type_description"]
                if answer["successful"] and self._types.describe(description, hash).name == name:
                    return description
                why = f"{node.name} answers: {answer['failure_reason'][:200] or 'it is not known'}"
            except TimeoutError:
                self._silent.add(node.name)
                why = f"{node.name}: no answer"
            except (CallError, CdrError, DefinitionError) as error:
                why = f"{node.name}: {str(error)[:200]}"
            _log.info("%s is not described: %s", name, why)
        raise DefinitionError(f"the type {name} is not known, and none of {len(nodes)} nodes describes it ({why})")

    async def _ask(self, node: Interface, payload: bytes) -> dict[str, Any]:
        """Return the answer of a node. Raises TimeoutError, CallError, CdrError, and DefinitionError without asking."""
        if self._spent_s >= MOST_S:
            raise DefinitionError(f"nodes have taken more than {MOST_S:g} s to describe types, and are not asked again")
        begun_s = time.monotonic()
        try:
            async with asyncio.timeout(ANSWER_S):
                answer = await self._graph.call(node, payload, MAX_DESCRIPTION_BYTES)
            return self._service.response.read(answer, MAX_DESCRIPTION_BYTES)
        finally:
            self._spent_s += time.monotonic() - begun_s


def _shared(one: str, other: str) -> int:
    """Return how many leading parts two names share."""
    parts = zip(one.split("/"), other.split("/"), strict=False)
    return next((index for index, (a, b) in enumerate(parts) if a != b), min(one.count("/"), other.count("/")))
