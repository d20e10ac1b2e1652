"""Services of ROS nodes: calls that are bounded in time, and the parameters of a node."""

import asyncio
import logging
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from linked_fleet_agent.robots.ros2.definitions import DefinitionError
from linked_fleet_agent.robots.ros2.graph import CallError, Graph, Interface, Offer, Role
from linked_fleet_agent.robots.ros2.serialization import CdrError
from linked_fleet_agent.robots.ros2.types import MessageTypes

_log = logging.getLogger(__name__)

GET_PARAMETERS = "rcl_interfaces/srv/GetParameters"
ANSWER_S = 2.0
"""Longest wait for the answer of a service."""
MAX_ANSWER_BYTES = 1_048_576
_FIELDS = {
    1: "bool_value",
    2: "integer_value",
    3: "double_value",
    4: "string_value",
    8: "double_array_value",
    9: "string_array_value",
}
"""The fields of an rcl_interfaces/ParameterValue by its type."""


class NoAnswerError(Exception):
    """A service has not answered, or with what cannot be read; the message says which."""


async def ask(graph: Graph, types: MessageTypes, service: str, type: str, request: dict[str, Any]) -> dict[str, Any]:
    """Call a service and return its response. Raises NoAnswerError."""
    stated = hash_of(graph.offers(), "service", service, type)
    try:
        known = types.service(type, stated)
        async with asyncio.timeout(ANSWER_S):
            answer = await graph.call(Interface(service, type), known.request.write(request), MAX_ANSWER_BYTES)
        return known.response.read(answer, MAX_ANSWER_BYTES)
    except TimeoutError:
        raise NoAnswerError(f"{service} does not answer") from None
    except (CallError, CdrError, DefinitionError) as error:
        raise NoAnswerError(str(error)) from error


def hash_of(offers: Iterable[Offer], role: Role, name: str, type: str) -> str:
    """Return the hash of a type as the node that offers an interface states it; empty if it states none."""
    said = (each.type_hash for each in offers if each.role == role and each.interface == Interface(name, type))
    return next(filter(None, said), "")


async def parameters_of(graph: Graph, types: MessageTypes, node: str, names: Sequence[str]) -> Mapping[str, object]:
    """Return parameters of a node by name; nothing if it does not say."""
    service = f"{node}/get_parameters"
    if not any((each.role, each.interface.name) == ("service", service) for each in graph.offers()):
        return {}
    try:
        answer = await ask(graph, types, service, GET_PARAMETERS, {"names": list(names)})
        if len(names) > 1 and not answer["values"]:  # a node of rclcpp that lacks one of them tells of none
            alone = [await parameters_of(graph, types, node, [name]) for name in names]
            return {name: value for each in alone for name, value in each.items()}
    except NoAnswerError as error:
        _log.info("%s", error)
        return {}
    return dict(zip(names, map(_value, answer["values"]), strict=False))


def texts(value: object) -> tuple[str, ...]:
    """Return the texts of a parameter that is an array of them; nothing of another one."""
    return tuple(value) if isinstance(value, list) and all(isinstance(each, str) for each in value) else ()


def _value(said: Mapping[str, Any]) -> object:
    return said[_FIELDS[said["type"]]] if said["type"] in _FIELDS else None
