"""Log records as text or JSON, and the current request, for code far from its handler.

A record is one line even if names contain control characters. The current request has an id for log records, and its
start time. Tasks, timers and fan-out turns started by a request inherit its context and may outlive it. So the context
becomes empty when the response starts.
"""

import json
import logging
import random
import re
import time
from contextlib import AbstractContextManager
from contextvars import ContextVar
from dataclasses import dataclass, field
from datetime import UTC, datetime
from typing import Literal, get_args

from linked_fleet_runtime.tracing import NO_SPAN, ChildSpan, Trace

_ID = re.compile(rb"[A-Za-z0-9._-]{1,64}")


@dataclass
class RequestContext:
    """A request in progress; ``started_s`` is monotonic, ``trace`` is set if requests are traced."""

    id: str
    started_s: float = field(default_factory=lambda: time.monotonic())
    response_started: bool = False
    trace: Trace | None = None


_asked: ContextVar[RequestContext | None] = ContextVar("asked", default=None)


def begin_request(proposed: bytes | None) -> RequestContext:
    """Start a request. A valid proposed id is kept."""
    asked = RequestContext(choose_request_id(proposed))
    _asked.set(asked)
    return asked


def choose_request_id(proposed: bytes | None) -> str:
    """Return the proposed id of a request if it is valid, else a new one."""
    if proposed and _ID.fullmatch(proposed):
        return proposed.decode("ascii")
    return f"{random.getrandbits(128):032x}"  # it is no secret, so a fast generator suffices


def current_request() -> RequestContext | None:
    """Return the current request; None outside of one."""
    asked = _asked.get()
    return None if asked is None or asked.response_started else asked


def child_span(name: str, *, is_client: bool = False, **attributes: str) -> AbstractContextManager[ChildSpan | None]:
    """Return a span within that of the current request; without one, a context manager that yields None.

    ``is_client`` marks a call to another process, whose attributes are then set on the whole request too.
    """
    trace = current_trace()
    if trace is None:
        return NO_SPAN
    if is_client:
        trace.set_attributes(attributes)
    return trace.start_child_span(name, is_client, attributes)


def current_trace() -> Trace | None:
    """Return the trace of the current request."""
    asked = current_request()
    return None if asked is None else asked.trace


LogFormat = Literal["text", "json"]
LOG_FORMATS: tuple[str, ...] = get_args(LogFormat)
_FIELDS = ("robot", "subscription", "who", "what", "target", "outcome", "result", "reason")
_TEXT = "%(asctime)s %(levelname)s %(name)s: %(message)s"
# Names come from the network: they must not start a new line or control a terminal.
_VISIBLE = {code: f"\\x{code:02x}" for code in (*range(0x20), *range(0x7F, 0xA0))} | {
    code: f"\\u{code:04x}" for code in (0x2028, 0x2029)
}


def configure_logging(form: str) -> None:
    """Write all log records to standard error in this form."""
    # What no format shows is not looked up (Python's logging HOWTO, "Optimization").
    logging.logThreads = logging.logProcesses = logging.logMultiprocessing = False
    logging._srcfile = None
    handler = logging.StreamHandler()
    handler.setFormatter(create_formatter(form))
    logging.basicConfig(level=logging.INFO, handlers=[handler])


def create_formatter(form: str) -> logging.Formatter:
    return JsonFormatter() if form == "json" else TextFormatter(_TEXT)


class TextFormatter(logging.Formatter):
    """Text records, followed by the ids of the current request and its trace."""

    _second, _clock = -1, ""

    def formatTime(self, record: logging.LogRecord, datefmt: str | None = None) -> str:  # noqa: N802 -- as above
        """Return the local time as in ``logging``; all records of one second share the text of it."""
        second = int(record.created)
        if second != self._second:
            self._second, self._clock = second, time.strftime(self.default_time_format, time.localtime(second))
        return f"{self._clock},{int(record.msecs):03}"

    def formatMessage(self, record: logging.LogRecord) -> str:  # noqa: N802 -- named by the library
        asked = current_request()
        line = super().formatMessage(record)
        if not line.isprintable():  # a tenth of the time of a translation, which changes almost no line
            line = line.translate(_VISIBLE)
        if asked is None:
            return line
        trace = "" if asked.trace is None else f" trace {asked.trace.id}"
        return f"{line} [request {asked.id}{trace}]"


class JsonFormatter(logging.Formatter):
    """JSON records: ``time`` (RFC 3339), ``level``, ``logger``, ``message``.

    If known, ``robot``, ``subscription``, ``request``, ``trace_id``, ``exception``; for audit records ``who``,
    ``what``, ``target``, ``outcome``, ``result``, ``reason``.
    """

    def format(self, record: logging.LogRecord) -> str:
        said = {
            "time": datetime.fromtimestamp(record.created, UTC).isoformat(timespec="milliseconds"),
            "level": record.levelname.lower(),
            "logger": record.name,
            "message": record.getMessage(),
        }
        said |= {name: str(getattr(record, name)) for name in _FIELDS if hasattr(record, name)}
        if (asked := current_request()) is not None:
            said["request"] = asked.id
            if asked.trace is not None:
                said["trace_id"] = asked.trace.id
        if record.exc_info:
            said["exception"] = self.formatException(record.exc_info)
        return json.dumps(said)
