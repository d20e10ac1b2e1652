"""When a delivery that failed is tried again, and when no more; pure: clock and chance are passed in."""

from datetime import UTC
from email.utils import parsedate_to_datetime

BASE_S = 0.5
LONGEST_S = 300.0
SUSPEND_AFTER = 12
"""Failed attempts in a row after which nothing is tried until somebody resumes: about a quarter of an hour."""
LONGEST_WAIT_S = 3600.0
"""However far away a receiver's Retry-After is."""
_LONGEST_FIELD = 64


def delay_s(failures: int, draw: float) -> float:
    """Seconds until the next attempt after ``failures`` in a row, at least one; ``draw`` is random in [0, 1).

    Half of it is fixed (equal jitter): an attempt never follows at once, yet those of many subscriptions to one
    receiver that fell over do not come back together.
    """
    doublings = min(max(failures, 1) - 1, 16)  # a large exponent would overflow a float, and the cap holds long before
    ceiling = min(LONGEST_S, BASE_S * 2.0**doublings)
    return ceiling / 2 * (1 + draw)


def retry_after_s(field: str | None, now_s: float) -> float | None:
    """Seconds from ``now_s`` (Unix) that a Retry-After field (RFC 9110, 10.2.3) asks for; None if it is of no use."""
    if field is None or not field.isascii() or len(field) > _LONGEST_FIELD:
        return None
    text = field.strip()
    if text.isdigit():
        return min(float(text), LONGEST_WAIT_S)
    moment_s = _http_date_s(text)
    return None if moment_s is None else min(max(moment_s - now_s, 0.0), LONGEST_WAIT_S)


def _http_date_s(text: str) -> float | None:
    """Unix time of an HTTP-date in any of its three forms (RFC 9110, 5.6.7); None for anything else."""
    if not text[:3].isalpha():  # all three begin with a weekday, which the parser of e-mail dates does not insist on
        return None
    try:
        moment = parsedate_to_datetime(text)
        return (moment if moment.tzinfo else moment.replace(tzinfo=UTC)).timestamp()
    except (ValueError, OverflowError):
        return None
