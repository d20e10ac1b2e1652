"""Check of this machine's clock by what the kernel knows of it. That of Redis is compared in ``redis_server``."""

import ctypes
import sys

from linked_fleet_gateway.app.doctor.finding import Finding

_ERROR = 5  # TIME_ERROR of adjtimex(2): the clock is not synchronised
_TIMEX_BYTES = 1024  # struct timex has 208 on 64 bits; all zero asks and changes nothing


def this_machine() -> Finding:
    """Times of values, dates of certificates and lags of frames are as good as the clock."""
    if not sys.platform.startswith("linux"):
        return Finding("clocks", "that of this machine is not checked: it has no adjtimex", note=True)
    state = ctypes.CDLL(None, use_errno=True).adjtimex(ctypes.create_string_buffer(_TIMEX_BYTES))
    if state == _ERROR:
        sentence = "nobody sets the clock of this machine, as far as its kernel knows"
        return Finding("clocks", sentence, "have it set by NTP, on the host if this is a container", note=True)
    if state < 0:
        return Finding("clocks", "the kernel does not say whether anybody sets the clock of this machine", note=True)
    return Finding("clocks", "that of this machine is set by NTP")
