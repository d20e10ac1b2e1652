"""All errors of the client, as one tree.

ClientError
├── Unreachable         no answer, or not in time
├── BadAnswer           an answer that is not RDF, too large, or otherwise unusable
├── Problem             the server refused (RFC 9457)
│   └── Controlled      another client has control of the robot
├── ControlLost         this client has lost control of the robot
├── NoSuchThing         nothing has that name
├── InvalidInput        the input does not fit the shape of the action
├── Unsupported         the server does not offer the requested function
├── StillRunning        an invocation has not ended in time
└── StreamEnded         a stream takes no more samples
"""

import json
from collections.abc import Sequence
from http.client import responses
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import httpx

_LONGEST = 2000


class ClientError(Exception):
    """Base of all errors of the client; the text is for people."""


class Unreachable(ClientError):  # noqa: N818
    """No answer, or not in time."""


class BadAnswer(ClientError):  # noqa: N818
    """The answer is unusable."""


class NoSuchThing(ClientError, LookupError):  # noqa: N818
    """Nothing has that name; ``known`` are the valid names."""

    def __init__(self, message: str, known: Sequence[str] = ()) -> None:
        super().__init__(message)
        self.known = tuple(known)


class InvalidInput(ClientError, ValueError):  # noqa: N818
    """The input does not fit the shape of the action; one message per violation."""

    def __init__(self, messages: Sequence[str]) -> None:
        super().__init__("; ".join(messages))
        self.messages = tuple(messages)


class Unsupported(ClientError):  # noqa: N818
    """The server does not offer the requested function."""


class StillRunning(ClientError, TimeoutError):  # noqa: N818
    """The invocation has not ended in time; it continues."""


class StreamEnded(ClientError):  # noqa: N818
    """The stream takes no more samples; the text says why."""


class Problem(ClientError):  # noqa: N818
    """The server refused: problem details (RFC 9457), with the messages of the SHACL report if there is one."""

    def __init__(
        self, url: str, status: int, title: str = "", detail: str = "", type_: str = "", messages: Sequence[str] = ()
    ) -> None:
        self.url, self.status, self.title, self.detail, self.type = url, status, title, detail, type_
        self.messages = tuple(messages)
        super().__init__(self._text())

    def _text(self) -> str:
        said = ": ".join(part for part in (self.title, self.detail) if part)
        more = [message for message in self.messages if message not in said]
        return f"{self.status} {said or self.url}" + "".join(f"\n  - {message}" for message in more)


class Controlled(Problem):
    """Another client has control of the robot; ``detail`` says who, and until when."""


class ControlLost(ClientError):  # noqa: N818
    """The control lease that this client had has ended, or another client has it."""


_LOCKED = 423
_CONTROLLED = "https://w3id.org/linked-fleet/problems#controlled"


def problem(url: str, status: int, headers: "httpx.Headers", body: bytes) -> Problem:
    """Return the problem in an answer with status 4xx or 5xx. Without a usable body the status alone counts."""
    said = _problem(url, status, headers, body)
    if status != _LOCKED and said.type != _CONTROLLED:
        return said
    return Controlled(url, status, said.title, said.detail, said.type, said.messages)


def _problem(url: str, status: int, headers: "httpx.Headers", body: bytes) -> Problem:
    reason = responses.get(status, "")
    media_type = headers.get("content-type", "").partition(";")[0].strip().lower()
    if not media_type.endswith("json"):
        text = body.decode(errors="replace").strip() if media_type == "text/plain" else ""
        return Problem(url, status, reason, text[:_LONGEST])
    try:
        said = json.loads(body)
    except (ValueError, RecursionError):
        return Problem(url, status, reason, "the problem that it reports is not valid JSON")
    if not isinstance(said, dict):
        return Problem(url, status, reason)
    title, detail, type_ = (_text(said.get(name)) for name in ("title", "detail", "type"))
    return Problem(url, status, title or reason, detail, type_, _messages(said.get("report")))


def _messages(report: Any) -> list[str]:
    results = [result for result in report if isinstance(result, dict)] if isinstance(report, list) else []
    found = [(_text(result.get("path")), _text(result.get("message"))) for result in results]
    return [f"{path.rpartition('#')[2].rpartition('/')[2]}: {message}" if path else message for path, message in found]


def _text(value: Any) -> str:
    return value[:_LONGEST] if isinstance(value, str) else ""
