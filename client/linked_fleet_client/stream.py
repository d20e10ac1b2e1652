"""Streams: an action that is given a further input many times a second, over one WebSocket."""

from __future__ import annotations

import contextlib
import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from types import TracebackType
from typing import Any

import httpx
from websockets.exceptions import ConnectionClosed, InvalidHandshake, InvalidStatus
from websockets.http11 import Response
from websockets.sync.client import ClientConnection, connect
from websockets.typing import Subprotocol

from linked_fleet_client.errors import BadAnswer, ClientError, InvalidInput, StreamEnded, Unreachable, problem
from linked_fleet_client.vocabulary import document_of
from linked_fleet_client.web import HeldControl, Web, origin

MOST_SAMPLE_BYTES = 2048
_MOST_MESSAGE_BYTES = 256 * 1024
_SILENCE_S = 5.0
"""Servers say something four times a second; after this time without a message the connection is taken for broken."""
_INVALID = frozenset({1007, 1008, 1009})
"""Codes by which a server ends a stream because of what the client has sent."""


@dataclass(frozen=True)
class Told:
    """The statements of the robot and its server: ``values`` are the newest of all values of the component.

    ``time`` is that of the robot's clock at the latest measurement, None before the first one. ``silent`` is true while
    the robot has braked because no sample could be applied; ``speed_scale`` is the share of the asked speed that it
    gets, and ``limited_because`` why it is less.
    """

    time: float | None = None
    state: str = ""
    reason: str = ""
    driver: str = ""
    priority: str | None = None
    applied: int = 0
    dropped: Mapping[str, int] = field(default_factory=dict)
    silent: bool = False
    speed_scale: float | None = None
    limited_because: str = ""
    values: Mapping[str, Any] = field(default_factory=dict)


class Stream:
    """An open stream, as a context manager. Iterating yields what it is told, the newest only, until it has ended.

    The robot judges each sample by the age of what this client has *yielded* last: a loop that is slow to answer does
    not move it. Without samples it brakes within a fraction of a second. Not for several threads.
    """

    def __init__(self, web: Web, iri: str, protocol: str, control: HeldControl | None) -> None:
        self._web, self._url, self._protocol, self._control = web, document_of(iri), protocol, control
        self._told, self._socket = Told(), None  # type: tuple[Told, ClientConnection | None]
        self.invocation = ""
        """The IRI of its invocation, once something was told."""
        self.ended: str | None = None
        """The reason why it has ended; None while it has not."""

    def __enter__(self) -> Stream:
        """Open it. Raises Problem, Controlled or ControlLost where a motion would be refused; Unreachable."""
        try:
            self._socket = connect(
                "ws" + self._url.removeprefix("http"), subprotocols=[Subprotocol(self._protocol)],
                additional_headers=self._fields(), compression=None, max_size=_MOST_MESSAGE_BYTES,
                open_timeout=self._web.timeout_s, close_timeout=self._web.timeout_s,
            )  # fmt: skip
        except InvalidStatus as error:
            raise _refusal(self._url, error.response) from error
        except (OSError, InvalidHandshake, EOFError) as error:
            raise Unreachable(f"{self._url} cannot be opened as a stream: {error}") from error
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        """Close it, which brakes the robot."""
        if self._socket is not None:
            self._socket.close()

    def send(self, /, **given: Any) -> bool:
        """Send an input of the action: numbers in its own units, and mappings of them.

        Returns False if nothing was sent, because the robot has told no time yet. Raises StreamEnded, InvalidInput.
        """
        if self.ended is not None:
            raise StreamEnded(f"the stream has ended: {self.ended}")
        if self._told.time is None:
            return False
        sample = json.dumps({"seen": self._told.time, "input": given})
        if len(sample.encode()) > MOST_SAMPLE_BYTES:
            raise InvalidInput([f"a sample has at most {MOST_SAMPLE_BYTES} bytes; this one has {len(sample.encode())}"])
        try:
            self._open.send(sample)
        except ConnectionClosed as closed:
            raise self._end_of(closed) from closed
        return True

    def __iter__(self) -> Iterator[Told]:
        """Yield what it is told. Raises InvalidInput if the server ends it because of a sample; Unreachable."""
        while self.ended is None:
            with contextlib.suppress(StreamEnded):
                self._hear()
                yield self._told

    def _hear(self) -> None:
        """Wait for a message, and take those that have come meanwhile."""
        self._take(_SILENCE_S)
        with contextlib.suppress(TimeoutError):
            while True:
                self._take(0.0)

    def _take(self, wait_s: float) -> None:
        try:
            said = _members(self._url, self._open.recv(wait_s))
        except ConnectionClosed as closed:
            raise self._end_of(closed) from closed
        except TimeoutError as error:
            if not wait_s:
                raise
            raise Unreachable(f"{self._url} has said nothing for {wait_s:g} s") from error
        self._told = _told(self._told, said)
        self.invocation = said.get("invocation", self.invocation)
        if said.get("ended"):
            self.ended = self._told.reason

    @property
    def _open(self) -> ClientConnection:
        if self._socket is None:
            raise StreamEnded("the stream is not open: use it as a context manager")
        return self._socket

    def _fields(self) -> dict[str, str]:
        fields = self._web.credentials(self._url)
        if self._control is None:
            return fields
        self._control.check()
        return fields | (self._control.proof if origin(self._url) == origin(self._control.iri) else {})

    def _end_of(self, closed: ConnectionClosed) -> ClientError:
        """Return the error for a connection that is closed, and note why it is."""
        code, reason = (1006, "") if closed.rcvd is None else (closed.rcvd.code, closed.rcvd.reason)
        if self.ended is None and code in _INVALID:
            self.ended = reason
            return InvalidInput([reason])
        if self.ended is None and closed.rcvd is None:
            self.ended = "the connection was lost"
            return Unreachable(f"{self._url}: the connection was lost")
        self.ended = self.ended if self.ended is not None else reason
        return StreamEnded(f"the stream has ended: {self.ended}")


def _refusal(url: str, response: Response) -> ClientError:
    headers = httpx.Headers(list(response.headers.raw_items()))
    return problem(url, response.status_code, headers, bytes(response.body or b""))


def _members(url: str, message: str | bytes) -> dict[str, Any]:
    try:
        said = json.loads(message)
    except (ValueError, RecursionError) as error:
        raise BadAnswer(f"{url} says what is no JSON") from error
    wrong = not isinstance(said, dict) or [name for name, kinds in _KINDS.items() if not _is(said.get(name), kinds)]
    if wrong:
        raise BadAnswer(f"{url} says what is no message of a stream")
    return said  # type: ignore[no-any-return]  # a dictionary, as was checked


_NUMBER, _NOTHING = (int, float), type(None)
_KINDS: dict[str, tuple[type, ...]] = {
    "time": (*_NUMBER, _NOTHING),
    "state": (str, _NOTHING),
    "reason": (str, _NOTHING),
    "driver": (str, _NOTHING),
    "priority": (str, _NOTHING),
    "applied": (int, _NOTHING),
    "dropped": (dict, _NOTHING),
    "silent": (bool, _NOTHING),
    "speedScale": (*_NUMBER, _NOTHING),
    "limitedBecause": (str, _NOTHING),
    "values": (dict, _NOTHING),
    "invocation": (str, _NOTHING),
}


def _is(value: object, kinds: tuple[type, ...]) -> bool:
    return isinstance(value, kinds) and (bool in kinds or not isinstance(value, bool))


def _told(before: Told, said: Mapping[str, Any]) -> Told:
    return replace(
        before,
        time=said.get("time", before.time),
        state=said.get("state") or before.state,
        reason=said.get("reason") or "",
        driver=said.get("driver") or "",
        priority=said.get("priority"),
        applied=said.get("applied") or 0,
        dropped=said.get("dropped") or {},
        silent=bool(said.get("silent")),
        speed_scale=said.get("speedScale"),
        limited_because=said.get("limitedBecause") or "",
        values={**before.values, **(said.get("values") or {})},
    )
