"""The request that is being answered, for those far from it: what they log bears its id, and its beginning is known.

Whatever a request starts inherits its context, timers and turns of the fan-out too, and may live much longer. So the
context is empty again from the moment the answer begins.
"""

import random
import re
import time
from contextlib import AbstractContextManager
from contextvars import ContextVar
from dataclasses import dataclass, field

from linked_fleet_gateway.runtime.tracing import NO_STEP, Step, Trace

_ID = re.compile(r"[A-Za-z0-9._-]{1,64}")


@dataclass
class RequestContext:
    """A request under way; ``begun_s`` is monotonic, ``trace`` is there if requests are traced."""

    id: str
    begun_s: float = field(default_factory=lambda: time.monotonic())
    answered: bool = False
    trace: Trace | None = None


_asked: ContextVar[RequestContext | None] = ContextVar("asked", default=None)


def begin(proposed: str) -> RequestContext:
    """Make a request the present one. It keeps the id that it came with, if that is one."""
    # Made for each request: no secret, so that it need not be asked of the kernel.
    asked = RequestContext(proposed if proposed and _ID.fullmatch(proposed) else f"{random.getrandbits(128):032x}")
    _asked.set(asked)
    return asked


def present() -> RequestContext | None:
    """The request that is being answered; None outside of any."""
    asked = _asked.get()
    return None if asked is None or asked.answered else asked


def step(name: str, *, asks: bool = False, **attributes: str) -> AbstractContextManager[Step | None]:
    """A span within that of the present request; None is entered where there is none.

    ``asks``: of another process, which what it is about is then known of the whole request.
    """
    trace = traced()
    if trace is None:
        return NO_STEP
    if asks:
        trace.about(attributes)
    return trace.step(name, asks, attributes)


def traced() -> Trace | None:
    """The trace of the request that is being answered."""
    asked = present()
    return None if asked is None else asked.trace
