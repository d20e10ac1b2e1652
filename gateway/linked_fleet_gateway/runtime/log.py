"""Lines of the log, as text for people or as JSON for machines; one line a record, whatever names say."""

import json
import logging
from datetime import UTC, datetime
from typing import Literal, get_args

from linked_fleet_gateway.runtime.request_context import present

Form = Literal["text", "json"]
FORMS: tuple[str, ...] = get_args(Form)
_FIELDS = ("robot", "subscription", "who", "what", "target", "outcome", "result")
_TEXT = "%(asctime)s %(levelname)s %(name)s: %(message)s"
# Names come from the network: none of them begins a line of its own, or moves a cursor.
_VISIBLE = {code: f"\\x{code:02x}" for code in (*range(0x20), *range(0x7F, 0xA0))} | {
    code: f"\\u{code:04x}" for code in (0x2028, 0x2029)
}


def configure(form: str) -> None:
    """Have all that is logged from here on written to standard error."""
    handler = logging.StreamHandler()
    handler.setFormatter(formatter(form))
    logging.basicConfig(level=logging.INFO, handlers=[handler])


def formatter(form: str) -> logging.Formatter:
    return JsonFormatter() if form == "json" else TextFormatter(_TEXT)


class TextFormatter(logging.Formatter):
    """The message, and at its end the id of the request that is being answered, and of its trace."""

    def formatMessage(self, record: logging.LogRecord) -> str:  # noqa: N802 -- the name of the library
        asked = present()
        line = super().formatMessage(record).translate(_VISIBLE)
        if asked is None:
            return line
        trace = "" if asked.trace is None else f" trace {asked.trace.id}"
        return f"{line} [request {asked.id}{trace}]"


class JsonFormatter(logging.Formatter):
    """``time`` (RFC 3339), ``level``, ``logger``, ``message``;

    where known ``robot``, ``subscription``, ``request``, ``trace_id``, ``exception``;
    of the audit ``who``, ``what``, ``target``, ``outcome``, ``result``.
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
