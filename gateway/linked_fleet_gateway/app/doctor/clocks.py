"""Check of this machine's clock by the kernel's state. The clock of Redis is checked in ``redis_server``."""

import ctypes
import sys

from linked_fleet_gateway.app.doctor.finding import Finding

_ERROR = 5  # TIME_ERROR of adjtimex(2): the clock is not synchronised
_TIMEX_BYTES = 1024  # struct timex has 208 bytes on 64 bits; all zeros queries without a change


def this_machine() -> Finding:
    """Check that the clock is synchronised, on which times of values, certificates and lags of frames depend."""
    if not sys.platform.startswith("linux"):
        return Finding("clocks", "that of this machine is not checked: it has no adjtimex", note=True)
    state = ctypes.CDLL(None, use_errno=True).adjtimex(ctypes.create_string_buffer(_TIMEX_BYTES))
    if state == _ERROR:
        sentence = "nobody sets the clock of this machine, as far as its kernel knows"
        return Finding("clocks", sentence, "have it set by NTP, on the host if this is a container", note=True)
    if state < 0:
        return Finding("clocks", "the kernel does not say whether anybody sets the clock of this machine", note=True)
    return Finding("clocks", "that of this machine is set by NTP")
