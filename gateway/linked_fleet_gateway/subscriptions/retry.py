"""The back-off of failed deliveries. Pure: clock and random numbers are arguments."""

from datetime import UTC
from email.utils import parsedate_to_datetime

BASE_S = 0.5
LONGEST_S = 300.0
SUSPEND_AFTER = 12
"""Failed attempts in a row, within about a quarter of an hour, after which the subscription is suspended."""
LONGEST_WAIT_S = 3600.0
"""Limit of a receiver's Retry-After."""
_LONGEST_FIELD = 64


def delay_s(failures: int, draw: float) -> float:
    """Return the seconds until the next attempt after ``failures`` (≥ 1) in a row; ``draw`` is random in [0, 1).

    Half of the delay is fixed (equal jitter): an attempt never follows at once, yet the attempts of many subscriptions
    to one failed receiver are spread.
    """
    doublings = min(max(failures, 1) - 1, 16)  # a large exponent would overflow a float; the cap is reached long before
    ceiling = min(LONGEST_S, BASE_S * 2.0**doublings)
    return ceiling / 2 * (1 + draw)


def retry_after_s(field: str | None, now_s: float) -> float | None:
    """Return the seconds after ``now_s`` (Unix) in a Retry-After field (RFC 9110, 10.2.3); None if it is unusable."""
    if field is None or not field.isascii() or len(field) > _LONGEST_FIELD:
        return None
    text = field.strip()
    if text.isdigit():
        return min(float(text), LONGEST_WAIT_S)
    moment_s = _http_date_s(text)
    return None if moment_s is None else min(max(moment_s - now_s, 0.0), LONGEST_WAIT_S)


def _http_date_s(text: str) -> float | None:
    """Return the Unix time of an HTTP-date in any of its three forms (RFC 9110, 5.6.7); None for anything else."""
    if not text[:3].isalpha():  # all three begin with a weekday, which the parser of e-mail dates does not require
        return None
    try:
        moment = parsedate_to_datetime(text)
        return (moment if moment.tzinfo else moment.replace(tzinfo=UTC)).timestamp()
    except (ValueError, OverflowError):
        return None
