"""The trace of a command: ``traceparent`` of W3C Trace Context (PROTOCOL.md, "Traces")."""

import re
from dataclasses import dataclass

MAX_BYTES = 256
_TRACEPARENT = re.compile(r"(?!ff)([0-9a-f]{2})-(?!0{32})([0-9a-f]{32})-(?!0{16})([0-9a-f]{16})-([0-9a-f]{2})(-.*)?")


@dataclass(frozen=True)
class TraceParent:
    """The parent span and its ``sampled`` flag; ``str`` gives the header value in version 00."""

    trace_id: int
    span_id: int
    sampled: bool

    def __str__(self) -> str:
        return f"00-{self.trace_id:032x}-{self.span_id:016x}-{self.sampled:02x}"


def parse(text: str) -> TraceParent | None:
    """Parse a header value; None if invalid. Later versions are read like version 00 (Trace Context, 4.2.2.2)."""
    match = _TRACEPARENT.fullmatch(text) if len(text) <= MAX_BYTES else None
    if match is None or (match[1] == "00" and match[5]):
        return None
    return TraceParent(int(match[2], 16), int(match[3], 16), bool(int(match[4], 16) & 1))
