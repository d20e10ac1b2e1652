"""Internal requests: an extension sends requests to the gateway with the credentials of its client.

They pass all middleware. So authentication, rights, rate limits, constraints and audit apply as to any request, and
credentials revoked meanwhile are refused.
"""

import asyncio
import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final
from urllib.parse import unquote, urlsplit

from starlette.datastructures import Headers
from starlette.types import Message, Scope

from linked_fleet_base.errors import PROBLEM_JSON, BadRequest
from linked_fleet_gateway.http.arrival import arrival_of, create_arrival
from linked_fleet_gateway.http.request import Connection, gateway_of
from linked_fleet_runtime.log import current_request

LONGEST_REPLY: Final = 4 * 1024 * 1024
"""Default limit of the content in bytes."""
_CREDENTIALS: Final = (b"host", b"authorization", b"cookie", b"origin", b"traceparent")


class ReplyTooLong(Exception):  # noqa: N818
    """The content of a response exceeds the limit."""


@dataclass(frozen=True)
class Reply:
    """The response to an internal request."""

    status: int
    headers: Headers
    content: bytes

    @property
    def media_type(self) -> str:
        return self.headers.get("content-type", "").partition(";")[0].strip().lower()

    @property
    def problem(self) -> dict[str, Any]:
        """Return the problem details of a refusal (RFC 9457); a status and a title if it has none in JSON."""
        if self.media_type != PROBLEM_JSON:
            return {"status": self.status, "title": "Refused"}
        found: dict[str, Any] = json.loads(self.content)
        return found


async def ask(
    connection: Connection,
    method: str,
    target: str,
    *,
    fields: Mapping[str, str] | None = None,
    content: bytes = b"",
    longest: int = LONGEST_REPLY,
) -> Reply:
    """Return the response to ``method`` at ``target``, a path with query or a URL below the base of ``connection``.

    Host, credentials and address are those of ``connection``; ``fields`` are other fields. Event streams and callbacks
    are not available. Cancelling cancels the request. Raises BadRequest for a target elsewhere and within an internal
    request, ReplyTooLong.
    """
    if arrival_of(connection.scope).internal:
        raise BadRequest("An internal request makes no other one.")
    scope = _scope(connection, method, _local(target, connection.base), fields or {}, content)
    collector = _Collector(content, longest)
    # In a task, so that the context of the outer request is not changed.
    await asyncio.create_task(gateway_of(connection.scope)(scope, collector.receive, collector.send))
    return collector.reply()


def _local(target: str, base: str) -> str:
    """Return path and query of ``target``. Raises BadRequest for a URL that is not below ``base``."""
    path = target.removeprefix(base) if target.startswith(f"{base}/") else target
    try:
        path.encode("ascii")
        urlsplit(path)
    except ValueError:
        path = ""
    if not path.startswith("/") or path.startswith("//") or any(each <= " " or each == "#" for each in path):
        raise BadRequest(f"{target[:200]!r} is no path, such as /, and no URL below {base}/.")
    return path


def _scope(connection: Connection, method: str, target: str, fields: Mapping[str, str], content: bytes) -> Scope:
    of = connection.scope
    path, _, query = target.partition("?")
    headers = [each for each in of["headers"] if each[0] in _CREDENTIALS]
    headers += [(name.lower().encode("ascii"), value.encode("latin-1")) for name, value in fields.items()]
    if content:
        headers.append((b"content-length", str(len(content)).encode()))
    if (outer := current_request()) is not None:
        headers.append((b"x-request-id", outer.id.encode()))
    scope: Scope = {
        "type": "http", "asgi": of.get("asgi", {"version": "3.0"}), "http_version": "1.1", "method": method,
        "scheme": {"ws": "http", "wss": "https"}.get(of["scheme"], of["scheme"]), "root_path": "",
        "path": unquote(path), "raw_path": path.encode("ascii"), "query_string": query.encode("ascii"),
        "headers": headers, "client": of.get("client"), "server": of.get("server"),
        "state": {}, "extensions": {},
    }  # fmt: skip
    create_arrival(scope, internal=True)
    return scope


class _Collector:
    """Collects both directions of an ASGI exchange in memory."""

    def __init__(self, content: bytes, longest: int) -> None:
        self._content: bytes | None = content
        self._longest = longest
        self._status = 0
        self._headers = Headers()
        self._parts: list[bytes] = []
        self._length = 0

    async def receive(self) -> Message:
        if self._content is None:
            # the client stays connected until the response is complete
            await asyncio.get_running_loop().create_future()
        content, self._content = self._content, None
        return {"type": "http.request", "body": content, "more_body": False}

    async def send(self, message: Message) -> None:
        if message["type"] == "http.response.start":
            self._status, self._headers = message["status"], Headers(raw=list(message.get("headers", ())))
            return
        self._parts.append(message.get("body", b""))
        self._length += len(self._parts[-1])
        if self._length > self._longest:
            raise ReplyTooLong(f"The answer is longer than {self._longest} bytes.")

    def reply(self) -> Reply:
        return Reply(self._status, self._headers, b"".join(self._parts))
