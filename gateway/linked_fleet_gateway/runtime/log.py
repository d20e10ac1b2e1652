"""Log records as text or JSON, one line each even if names contain control characters."""

import json
import logging
from datetime import UTC, datetime
from typing import Literal, get_args

from linked_fleet_gateway.runtime.request_context import present

Form = Literal["text", "json"]
FORMS: tuple[str, ...] = get_args(Form)
_FIELDS = ("robot", "subscription", "who", "what", "target", "outcome", "result")
_TEXT = "%(asctime)s %(levelname)s %(name)s: %(message)s"
# Names come from the network: they must not start a new line or control a terminal.
_VISIBLE = {code: f"\\x{code:02x}" for code in (*range(0x20), *range(0x7F, 0xA0))} | {
    code: f"\\u{code:04x}" for code in (0x2028, 0x2029)
}


def configure(form: str) -> None:
    """Write all log records to standard error in this form."""
    # What no format shows is not looked up (Python's logging HOWTO, "Optimization").
    logging.logThreads = logging.logProcesses = logging.logMultiprocessing = False
    logging._srcfile = None
    handler = logging.StreamHandler()
    handler.setFormatter(formatter(form))
    logging.basicConfig(level=logging.INFO, handlers=[handler])


def formatter(form: str) -> logging.Formatter:
    return JsonFormatter() if form == "json" else TextFormatter(_TEXT)


class TextFormatter(logging.Formatter):
    """Text records, followed by the ids of the current request and its trace."""

    def formatMessage(self, record: logging.LogRecord) -> str:  # noqa: N802 -- named by the library
        asked = present()
        line = super().formatMessage(record).translate(_VISIBLE)
        if asked is None:
            return line
        trace = "" if asked.trace is None else f" trace {asked.trace.id}"
        return f"{line} [request {asked.id}{trace}]"


class JsonFormatter(logging.Formatter):
    """JSON records: ``time`` (RFC 3339), ``level``, ``logger``, ``message``.

    If known, ``robot``, ``subscription``, ``request``, ``trace_id``, ``exception``; for audit records ``who``,
    ``what``, ``target``, ``outcome``, ``result``.
    """

    def format(self, record: logging.LogRecord) -> str:
        said = {
            "time": datetime.fromtimestamp(record.created, UTC).isoformat(timespec="milliseconds"),
            "level": record.levelname.lower(),
            "logger": record.name,
            "message": record.getMessage(),
        }
        said |= {name: str(getattr(record, name)) for name in _FIELDS if hasattr(record, name)}
        if (asked := present()) is not None:
            said["request"] = asked.id
            if asked.trace is not None:
                said["trace_id"] = asked.trace.id
        if record.exc_info:
            said["exception"] = self.formatException(record.exc_info)
        return json.dumps(said)
