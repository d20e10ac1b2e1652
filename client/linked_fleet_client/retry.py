"""The repetition of requests, and the pause before: Retry-After is honoured (RFC 9110, 10.2.3), within bounds."""

import time
from collections.abc import Mapping
from datetime import UTC
from email.utils import parsedate_to_datetime
from enum import Enum, auto

ATTEMPTS = 5
"""Most attempts at one request; without a Retry-After field three."""
PATIENCE_S = 15.0
"""Longest time of all pauses between the attempts at one request."""
_UNTOLD_ATTEMPTS = 3
_FIRST_PAUSE_S = 0.1
_PASSING = frozenset({502, 503, 504})
_TOLD = frozenset({429, 503})
_LONGEST_S = 1e6


class Repeat(Enum):
    """The ways in which a request may be repeated."""

    SAFE = auto()
    """It changes nothing: it is repeated also after a broken connection."""
    IDEMPOTENT = auto()
    """Twice, it does the same as once: it is repeated if the server is busy and says until when."""
    STOP = auto()
    """It stops something, so that it is repeated at once."""
    NEVER = auto()


def repeat_of(method: str, headers: Mapping[str, str]) -> Repeat:
    """Return how a request may be repeated: if its method is idempotent (RFC 9110, 9.2.2), or if it has a key."""
    keyed = any(name.lower() == "idempotency-key" for name in headers)
    return Repeat.IDEMPOTENT if keyed or method in ("PUT", "DELETE") else Repeat.NEVER


class Attempts:
    """The attempts at one request. ``patience_s`` bounds the time of all pauses."""

    def __init__(self, repeat: Repeat, patience_s: float) -> None:
        self._repeat, self._patience_s = repeat, patience_s
        self._made = 0

    def pause_s(self, status: int | None = None, retry_after: str | None = None) -> float | None:
        """Return the pause before the next attempt after this answer, or None if there is none to be made.

        ``status`` is None if the connection was broken. A server that wants more than the patience is not asked again.
        """
        self._made += 1
        pause_s, most = self._wanted(status, parse_retry_after(retry_after) if status in _TOLD else None)
        if pause_s is None or self._made >= most or pause_s > self._patience_s:
            return None
        self._patience_s -= pause_s
        return pause_s

    def _wanted(self, status: int | None, told_s: float | None) -> tuple[float | None, int]:
        """Return the pause, if any, and the number of attempts."""
        if self._repeat is Repeat.NEVER:
            return None, 1
        if self._repeat is Repeat.STOP:
            return (0.0 if status in (None, 502, 503) else None), _UNTOLD_ATTEMPTS  # 504 is no reply of the robot
        backoff_s = _FIRST_PAUSE_S * 4 ** (self._made - 1)
        if told_s is not None:
            return max(told_s, _FIRST_PAUSE_S), ATTEMPTS
        safe = self._repeat is Repeat.SAFE and status in (None, *_PASSING)
        return (backoff_s if safe else None), _UNTOLD_ATTEMPTS


def parse_retry_after(field: str | None) -> float | None:
    """Return the seconds that a Retry-After field names, a number or a date; None if there is none that is usable."""
    text = (field or "").strip()
    if text.isascii() and text.isdigit():
        return min(float(text[:9]), _LONGEST_S)
    try:
        date = parsedate_to_datetime(text)
    except ValueError:
        return None
    at = date if date.tzinfo else date.replace(tzinfo=UTC)
    return min(max(0.0, at.timestamp() - time.time()), _LONGEST_S)
