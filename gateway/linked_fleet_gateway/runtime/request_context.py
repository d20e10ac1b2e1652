"""The current request, for code far from the handler: its id for log records, and its start time.

Tasks, timers and fan-out turns started by a request inherit its context and may outlive it. So the context becomes
empty when the response starts.
"""

import random
import re
import time
from contextlib import AbstractContextManager
from contextvars import ContextVar
from dataclasses import dataclass, field

from linked_fleet_gateway.runtime.tracing import NO_STEP, Step, Trace

_ID = re.compile(rb"[A-Za-z0-9._-]{1,64}")


@dataclass
class RequestContext:
    """A request in progress; ``begun_s`` is monotonic, ``trace`` is set if requests are traced."""

    id: str
    begun_s: float = field(default_factory=lambda: time.monotonic())
    answered: bool = False
    trace: Trace | None = None


_asked: ContextVar[RequestContext | None] = ContextVar("asked", default=None)


def begin(proposed: bytes | None) -> RequestContext:
    """Start a request. A valid proposed id is kept."""
    asked = RequestContext(request_id(proposed))
    _asked.set(asked)
    return asked


def request_id(proposed: bytes | None) -> str:
    """Return the proposed id of a request if it is valid, else a new one."""
    if proposed and _ID.fullmatch(proposed):
        return proposed.decode("ascii")
    return f"{random.getrandbits(128):032x}"  # it is no secret, so a fast generator suffices


def present() -> RequestContext | None:
    """Return the current request; None outside of one."""
    asked = _asked.get()
    return None if asked is None or asked.answered else asked


def step(name: str, *, asks: bool = False, **attributes: str) -> AbstractContextManager[Step | None]:
    """Return a span within that of the current request; without one, a context manager that yields None.

    ``asks`` marks a call to another process, whose attributes are then set on the whole request too.
    """
    trace = traced()
    if trace is None:
        return NO_STEP
    if asks:
        trace.about(attributes)
    return trace.step(name, asks, attributes)


def traced() -> Trace | None:
    """Return the trace of the current request."""
    asked = present()
    return None if asked is None else asked.trace
