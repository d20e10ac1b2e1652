"""The request that is being answered, for those far from it: what they log bears its id, and its beginning is known.

Whatever a request starts inherits its context, timers and turns of the fan-out too, and may live much longer. So the
context is empty again from the moment the answer begins.
"""

import re
import time
import uuid
from contextvars import ContextVar
from dataclasses import dataclass, field

_ID = re.compile(r"[A-Za-z0-9._-]{1,64}")


@dataclass
class Asked:
    """A request under way; ``begun_s`` is monotonic."""

    id: str
    begun_s: float = field(default_factory=time.monotonic)
    answered: bool = False


_asked: ContextVar[Asked | None] = ContextVar("asked", default=None)


def begin(proposed: str) -> Asked:
    """Make a request the present one. It keeps the id that it came with, if that is one."""
    asked = Asked(proposed if _ID.fullmatch(proposed) else uuid.uuid4().hex)
    _asked.set(asked)
    return asked


def present() -> Asked | None:
    """The request that is being answered; None outside of any."""
    asked = _asked.get()
    return None if asked is None or asked.answered else asked
