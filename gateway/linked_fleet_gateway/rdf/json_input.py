"""JSON documents from clients: bounded in depth and size, and unambiguous.

Of two members with one name ``json`` keeps the last, other parsers the first. A lone surrogate is a Python string that
no encoder accepts. Both are refused here, for plain JSON and for JSON-LD alike.
"""

import json
import re
from collections.abc import Callable
from itertools import chain
from typing import Any

from linked_fleet_gateway.rdf.parse_error import ParseError

# Matches the text up to the first escape of a lone surrogate. Possessive quantifiers keep it to one pass.
_PAIRED = re.compile(
    r"(?:[^\\]++|\\u[dD][89abAB][0-9a-fA-F]{2}\\u[dD][c-fC-F][0-9a-fA-F]{2}|\\u(?![dD][89a-fA-F])|\\[^u])*+"
)


def load_json(text: str, max_depth: int, max_values: int, number: Callable[[str], Any] | None = None) -> Any:
    """Parse a document, with numbers converted by ``number``. Raises ParseError."""
    # A cheap upper bound of the number of values; characters within strings count too.
    if text.count(",") + text.count("[") + text.count("{") > max_values:
        raise ParseError(f"JSON has more than {max_values} commas and opening brackets")
    try:
        document = json.loads(
            text,
            parse_int=number,
            parse_float=number,
            parse_constant=_refuse_constant,
            object_pairs_hook=_unique_members,
        )
    except RecursionError as error:
        raise _too_deep(max_depth) from error
    except json.JSONDecodeError as error:
        raise ParseError(error.msg, error.lineno, error.colno) from error
    except ValueError as error:  # an integer with more digits than Python converts
        raise ParseError(f"unacceptable JSON: {error}") from error
    _check_depth(document, max_depth)
    _refuse_lone_surrogates(text)
    return document


def _check_depth(document: Any, max_depth: int) -> None:
    """Count the levels of objects and arrays, one level at a time."""
    level, depth = [document], 0
    while level := [each for each in level if type(each) in (dict, list)]:
        depth += 1
        if depth > max_depth:
            raise _too_deep(max_depth)
        level = list(chain.from_iterable(each.values() if type(each) is dict else each for each in level))


def _too_deep(max_depth: int) -> ParseError:
    return ParseError(f"JSON is nested more than {max_depth} deep")


def _refuse_lone_surrogates(text: str) -> None:
    if "\\u" not in text:
        return
    match = _PAIRED.match(text)
    at = match.end() if match is not None else 0
    if at < len(text):
        line, column = text.count("\n", 0, at) + 1, at - text.rfind("\n", 0, at)
        escape = text[at : at + 6]
        raise ParseError(f"{escape} is half of a surrogate pair, which no text can hold", line, column)


def _unique_members(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    members = dict(pairs)
    if len(members) != len(pairs):
        raise ParseError("an object has two members of the same name")
    return members


def _refuse_constant(name: str) -> float:
    raise ParseError(f"{name} is not JSON")
