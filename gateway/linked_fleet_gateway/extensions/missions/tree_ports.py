"""Ports of BehaviorTree.CPP 4: attributes whose text is a value, an entry of the blackboard, or JSON. Pure."""

import json
import math
import re
from collections.abc import Mapping
from typing import Any, Final

MEDIA_TYPE: Final = "application/vnd.behaviortree+xml"
FORMAT: Final = "4"
JSON: Final = "json:"
"""The prefix of JSON in a port, in BehaviorTree.CPP too."""
OWN_PORTS: Final = frozenset({"ID", "name", "action", "kind", "of", "body", "triples", "_description"})
"""Attributes of a leaf that are not members of the body of its action."""
TYPES: Final[Mapping[str, str]] = {
    "number": "double", "integer": "int64_t", "boolean": "bool", "text": "std::string", "iri": "iri",
}  # fmt: skip
"""Types of ports by those of parameters."""
OTHER_TYPES: Final[Mapping[str, str]] = {
    "double": "number", "float": "number", "int": "integer", "int64_t": "integer", "unsigned": "integer",
    "bool": "boolean", "std::string": "text", "string": "text", "iri": "iri",
}  # fmt: skip
"""Types of parameters by those of ports."""
_ENTRY: Final = re.compile(r"\{\s*(=|[A-Za-z_][A-Za-z0-9_]*(?:\.[A-Za-z_][A-Za-z0-9_]*)?)\s*\}")
_NUMBER: Final = re.compile(r"-?(0|[1-9][0-9]*)(\.[0-9]+)?([eE][+-]?[0-9]{1,4})?")
_UNSAFE: Final = re.compile("[^\x09\x0a\x0d\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
"""Characters that XML cannot have."""
_PORT: Final = re.compile(r"[A-Za-z][A-Za-z0-9_]*")


class PortError(ValueError):
    """The text of a port cannot be read; the message says what would be right."""


def entry_of(text: str, port: str = "") -> str | None:
    """Return the entry of the blackboard that a port names, such as ``{angle}``; None if it has a value."""
    found = _ENTRY.fullmatch(text)
    if found is not None:
        return port if found[1] == "=" else found[1]
    if text.startswith("{") and text.endswith("}"):
        raise PortError(f"{text[:60]!r} is neither the name of a parameter in braces, nor JSON after {JSON}")
    return None


def value_of(text: str) -> Any:
    """Return the JSON of a port: a number, true, false, what follows ``json:``, or else a text. Raises PortError."""
    is_json = text.startswith(JSON)
    if not is_json and not _NUMBER.fullmatch(text) and text not in ("true", "false"):
        return text
    try:
        value = json.loads(text.removeprefix(JSON), parse_constant=_finite, parse_float=_finite)
        json.dumps(value, ensure_ascii=False).encode()  # JSON can have half of a character, and no other text
    except (ValueError, RecursionError) as error:
        what = f"has no JSON after {JSON}" if is_json else "is no number"
        raise PortError(f"{text[:60]!r} {what}: {error}") from error
    return value


def _finite(text: str) -> float:
    number = float(text)
    if not math.isfinite(number):
        raise ValueError(f"{text[:20]} is not finite")
    return number


def text_of(text: str) -> str:
    """Return the port that ``value_of`` and ``entry_of`` read as this text."""
    plain = not (text.startswith((JSON, "{")) or _NUMBER.fullmatch(text) or text in ("true", "false"))
    return text if plain and not _UNSAFE.search(text) else JSON + json.dumps(text)


def port_of(value: Any) -> str:
    """Return the port of a JSON value, in which ``{"variable": "x"}`` is an entry of the blackboard."""
    if isinstance(value, str):
        return text_of(value)
    if isinstance(value, dict) and value.keys() == {"variable"} and _ENTRY.fullmatch(f"{{{value['variable']}}}"):
        return f"{{{value['variable']}}}"
    said = json.dumps(value)
    is_plain = isinstance(value, bool) or (isinstance(value, int | float) and _NUMBER.fullmatch(said))
    return said if is_plain else JSON + said


def are_ports(body: Mapping[str, Any]) -> bool:
    """Return True if the members of a body can be ports, each of its own."""
    return bool(body) and all(_PORT.fullmatch(name) and name not in OWN_PORTS for name in body)


def default_of(text: str, type_: str) -> float | bool | str:
    """Return the default of a parameter of a type. Raises PortError."""
    value = text if type_ in ("text", "iri") and not text.startswith(JSON) else value_of(text)
    if not isinstance(value, int | float | str):
        raise PortError(f"the default {text[:60]!r} is no value of the type {type_}")
    return value
