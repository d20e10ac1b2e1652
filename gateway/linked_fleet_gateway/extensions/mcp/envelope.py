"""Checks of a message before the SDK gets it (JSON-RPC 2.0, 4 and 5; MCP, "Base protocol").

The SDK takes a request whose id it cannot read for a notification and does nothing, and answers two requests of one id
to the second. A stop would be lost either way.
"""

import json
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

_NOTIFICATIONS = "notifications/"
_ID_RULE = "the id of a request must be a string or an integer"


class InvalidMessage(ValueError):  # noqa: N818
    """The message is no request, notification or response; a sentence says what is wrong and what is right."""


def check_envelope(message: Any) -> None:
    """Raise InvalidMessage for a message that would be taken for another kind than its sender meant."""
    if not isinstance(message, dict):
        raise InvalidMessage("a message must be one JSON object; batches are not supported")
    if message.get("jsonrpc") != "2.0":
        raise InvalidMessage('the member jsonrpc must be "2.0"')
    if "id" in message:
        _check_id(message)
    if "method" in message:
        _check_method(message)
    elif "id" not in message or not ({"result", "error"} & message.keys()):
        raise InvalidMessage("a message needs a method, or as a response an id and a result or an error")


def request_id(message: dict[str, Any]) -> str | None:
    """Return the id of a request as text, by which the SDK tells requests apart; None for other messages."""
    return str(message["id"]) if "id" in message and "method" in message else None


class UnderWay:
    """Ids of requests that have no response yet, by session."""

    def __init__(self) -> None:
        self._ids = set[tuple[str, str, str]]()

    @contextmanager
    def held(self, client: str, session: str, id: str | None) -> Iterator[None]:
        """Keep an id in use. Raises InvalidMessage if it is in use already. A request outside of sessions is free."""
        key = (client, session, id or "")
        if id is None or not session:
            yield
            return
        if key in self._ids:
            raise InvalidMessage(
                f"the id {id[:100]!r} is that of a request of this session that has no response yet; take another one"
            )
        self._ids.add(key)
        try:
            yield
        finally:
            self._ids.discard(key)


def _check_id(message: dict[str, Any]) -> None:
    id = message["id"]
    if "error" in message and "method" not in message and id is None:
        return  # the response to a message whose id could not be read
    if isinstance(id, bool) or not isinstance(id, str | int):
        raise InvalidMessage(f"{_ID_RULE}, not {json.dumps(id)[:100]}")


def _check_method(message: dict[str, Any]) -> None:
    method = message["method"]
    if not isinstance(method, str):
        raise InvalidMessage("the member method must be a string")
    if "id" not in message and not method.startswith(_NOTIFICATIONS):
        raise InvalidMessage(f"{method[:100]} is a request and needs an id; {_ID_RULE}")
    if "id" in message and method.startswith(_NOTIFICATIONS):
        raise InvalidMessage(f"{method[:100]} is a notification and must have no id")
