"""Everything that can go wrong, as one tree.

ClientError
├── Unreachable         nobody answered, or not in time
├── BadAnswer           an answer that is no RDF, too large, or in other ways not to be understood
├── Problem             the server refused (RFC 9457)
├── NoSuchThing         nothing has that name
├── InvalidInput        what was given does not fit the shape of the action
├── Unsupported         the server does not offer what was asked for
└── StillRunning        an invocation had not ended in time
"""

import json
from collections.abc import Sequence
from http.client import responses
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import httpx

_LONGEST = 2000


class ClientError(Exception):
    """Base of all; the text is for humans."""


class Unreachable(ClientError):  # noqa: N818
    """Nobody answered, or not in time."""


class BadAnswer(ClientError):  # noqa: N818
    """The answer cannot be understood."""


class NoSuchThing(ClientError, LookupError):  # noqa: N818
    """Nothing has that name; ``known`` are the names that would have been right."""

    def __init__(self, message: str, known: Sequence[str] = ()) -> None:
        super().__init__(message)
        self.known = tuple(known)


class InvalidInput(ClientError, ValueError):  # noqa: N818
    """The input does not fit the shape of the action: one message per violation."""

    def __init__(self, messages: Sequence[str]) -> None:
        super().__init__("; ".join(messages))
        self.messages = tuple(messages)


class Unsupported(ClientError):  # noqa: N818
    """The server does not offer what was asked for."""


class StillRunning(ClientError, TimeoutError):  # noqa: N818
    """The invocation had not ended in time; it goes on."""


class Problem(ClientError):  # noqa: N818
    """The server refused: problem details (RFC 9457) with the messages of the SHACL report, where there is one."""

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


def problem(url: str, status: int, headers: "httpx.Headers", body: bytes) -> Problem:
    """The refusal that an answer of 4xx or 5xx is; the status alone counts where its body says nothing."""
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
