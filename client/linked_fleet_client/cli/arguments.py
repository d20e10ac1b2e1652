"""Parser of ``name=value`` arguments."""

import json
import re
from collections.abc import Sequence
from typing import Any

from linked_fleet_client.errors import ClientError

_STEP = re.compile(r"([^.\[\]]+)(?:\[(\d{1,3})\])?")


class BadArgument(ClientError):  # noqa: N818
    """An argument that is not ``name=value``."""


def nested(arguments: Sequence[str]) -> dict[str, Any]:
    """Return the nested mapping of the arguments; a repeated name collects its values in a list.

    ``a=1 b[0].c=2 b[1].c=3`` is the same as ``a=1 b='[{"c": 2}, {"c": 3}]'``.
    """
    found: dict[str, Any] = {}
    for argument in arguments:
        name, equals, text = argument.partition("=")
        parts = [_STEP.fullmatch(part) for part in name.split(".")]
        if not equals or not all(parts):
            raise BadArgument(f"{argument!r} is not of the form name=value")
        _put(found, [(part[1], part[2]) for part in parts if part], _value(argument, text))
    return {name: _lists(value) for name, value in found.items()}


def _value(argument: str, text: str) -> Any:
    if not text.startswith(("{", "[")):
        return text
    try:
        return json.loads(text)
    except (ValueError, RecursionError) as error:
        raise BadArgument(f"{argument!r} begins like JSON and is none: {error}") from error


class _Indexed(dict[int, Any]):
    """A list under construction, by index."""


def _put(into: dict[Any, Any], steps: Sequence[tuple[str, str | None]], value: Any) -> None:
    (name, index), *rest = steps
    if index is not None:
        into = _below(into, name, _Indexed)
        name = int(index)  # type: ignore[assignment]
    if rest:
        _put(_below(into, name, dict), rest, value)
    elif name in into:
        before = into[name]
        into[name] = [*(before if isinstance(before, list) else [before]), value]
    else:
        into[name] = value


def _below(into: dict[Any, Any], name: Any, kind: type[dict[Any, Any]]) -> dict[Any, Any]:
    below: Any = into.setdefault(name, kind())
    if not isinstance(below, kind):
        raise BadArgument(f"{name!r} is given both as a value and in parts")
    return below


def _lists(value: Any) -> Any:
    if isinstance(value, _Indexed):
        return [_lists(value[index]) for index in sorted(value)]
    return {name: _lists(each) for name, each in value.items()} if isinstance(value, dict) else value
