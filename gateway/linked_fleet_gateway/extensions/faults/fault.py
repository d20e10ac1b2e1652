"""The record of a fault, and how it changes. Pure values; times are wall nanoseconds, 0 if there is none.

A fault is *raised* by a sign, *confirmed* once that is no mere flap, *acknowledged* by a person, and *cleared* when the
trouble is over. A ``latched`` one stays until a person clears it. An ``event`` has no end of its own: acknowledging it
clears it. There is one fault for each robot, place and kind: trouble that comes back raises the same fault again.
"""

import uuid
from functools import lru_cache
from typing import Literal

from msgspec import Struct
from msgspec.structs import replace

from linked_fleet_gateway.api import Conflict

State = Literal["raised", "confirmed", "acknowledged", "cleared"]
Severity = Literal["information", "warning", "error", "critical"]
SEVERITIES: tuple[Severity, ...] = ("information", "warning", "error", "critical")
MOST_RECENT = 16
MOST_SAYS = 500
"""Characters of a sentence."""
_SPACE = uuid.UUID("6f6bb2a1-9d0c-4f5e-9f0e-3a7f6a5d1c11")


class Trouble(Struct, frozen=True, omit_defaults=True):
    """A trouble. ``place`` is the path of a thing, ``robots`` are those whose readers alone may know of it.

    ``says`` is a sentence. ``values`` are those at the time, by name. ``invocation`` is its path.
    """

    kind: str
    place: str
    robots: tuple[str, ...] = ()
    severity: Severity = "error"
    says: str = ""
    latched: bool = False
    event: bool = False
    values: dict[str, str] = {}
    invocation: str = ""

    @property
    def id(self) -> str:
        """The id of its fault, which is the same at all gateways."""
        return id_of(self.place, self.kind)


@lru_cache(4096)
def id_of(place: str, kind: str) -> str:
    """Return the id of the fault of a kind at a thing."""
    return str(uuid.uuid5(_SPACE, f"{place}\0{kind}"))


class Fault(Struct, frozen=True, omit_defaults=True):
    """A fault: its trouble as it was last seen, and its life.

    ``count`` is how often the trouble came since ``since_ns``, ``before`` how often in earlier appearances. ``recent``
    are the ids of the last events, so that no gateway counts one again.
    """

    trouble: Trouble
    state: State
    since_ns: int
    last_ns: int
    count: int = 1
    before: int = 0
    present: bool = True
    """False if the trouble is over, or is an event."""
    confirmed_ns: int = 0
    acknowledged_ns: int = 0
    acknowledged_by: str = ""
    remark: str = ""
    cleared_ns: int = 0
    cleared_by: str = ""
    recent: tuple[str, ...] = ()
    told_ns: int = 0
    """Time at which people were last told of it by mail or chat."""

    @property
    def is_open(self) -> bool:
        """True until it is cleared."""
        return self.state != "cleared"

    @property
    def needs_attention(self) -> bool:
        """True while nobody has acknowledged it. Information needs none."""
        return self.state == "confirmed" and self.trouble.severity != "information"


class Sight(Struct, frozen=True):
    """A trouble as a gateway sees it: the verdict of its signal, or events."""

    trouble: Trouble
    verdict: Literal["absent", "raised", "confirmed"]
    present: bool
    since_ns: int
    last_ns: int
    count: int
    events: tuple[str, ...] = ()


def observe(fault: Fault | None, sight: Sight, now_ns: int) -> Fault | None:
    """Return the fault after what a gateway sees; None if there is none, or no longer."""
    if sight.verdict == "absent":
        return None if fault is None else over(fault, now_ns)
    if sight.trouble.event:
        return _happened(fault, sight, now_ns)
    if fault is None or not fault.is_open:
        return _raise_again(fault, sight, now_ns)
    if fault.state == "raised" and sight.verdict == "confirmed":
        fault = replace(fault, state="confirmed", confirmed_ns=now_ns)
    if not fault.present:  # a latched fault whose trouble has come back
        fault = replace(fault, before=fault.before + fault.count, since_ns=sight.since_ns, count=0)
        fault = _unacknowledged(fault, now_ns)
    if worse := SEVERITIES.index(sight.trouble.severity) > SEVERITIES.index(fault.trouble.severity):
        fault = _unacknowledged(fault, now_ns)
    latched = fault.trouble.latched or sight.trouble.latched
    severity = sight.trouble.severity if worse or not latched else fault.trouble.severity
    return replace(
        fault,
        trouble=replace(sight.trouble, latched=latched, severity=severity),
        present=True,
        count=max(fault.count, sight.count),  # another gateway may have counted more of the same appearance
        last_ns=max(fault.last_ns, sight.last_ns),
    )


def _unacknowledged(fault: Fault, now_ns: int) -> Fault:
    """Return a fault that has become worse, or has come back: who has acknowledged it did not know that."""
    if fault.state != "acknowledged":
        return fault
    return replace(fault, state="confirmed", confirmed_ns=now_ns, acknowledged_ns=0, acknowledged_by="")


def _raise_again(fault: Fault | None, sight: Sight, now_ns: int) -> Fault:
    confirmed = sight.verdict == "confirmed"
    return Fault(
        sight.trouble,
        "confirmed" if confirmed else "raised",
        sight.since_ns,
        sight.last_ns,
        sight.count,
        0 if fault is None else fault.before + fault.count,
        confirmed_ns=now_ns if confirmed else 0,
        told_ns=0 if fault is None else fault.told_ns,
    )


def _happened(fault: Fault | None, sight: Sight, now_ns: int) -> Fault | None:
    known = () if fault is None else fault.recent
    new = [each for each in sight.events if each not in known]
    if not new:
        return fault
    counted = sight.count - (len(sight.events) - len(new))
    recent = (*known, *new)[-MOST_RECENT:]
    if fault is None or not fault.is_open:
        again = _raise_again(fault, sight, now_ns)
        return replace(again, count=counted, present=False, recent=recent)
    fault = _unacknowledged(fault, now_ns)
    return replace(
        fault, trouble=sight.trouble, count=fault.count + counted, last_ns=sight.last_ns, recent=recent, present=False
    )


def over(fault: Fault, now_ns: int) -> Fault | None:
    """Return what becomes of a fault whose trouble is over. What was never confirmed leaves no trace."""
    if not fault.is_open or fault.trouble.event:
        return fault
    if fault.state == "raised":
        return None if not fault.before else replace(fault, state="cleared", present=False, cleared_ns=now_ns)
    if fault.trouble.latched:
        return replace(fault, present=False)
    return replace(fault, state="cleared", present=False, cleared_ns=now_ns)


def acknowledge(fault: Fault, by: str, now_ns: int) -> Fault:
    """Return a fault that a person has taken note of. Raises Conflict."""
    if not fault.is_open:
        raise Conflict("The fault is cleared; only one that is raised or confirmed can be acknowledged.")
    if fault.state == "acknowledged":
        raise Conflict(f"{fault.acknowledged_by or 'Somebody'} has acknowledged the fault already.")
    seen = replace(fault, acknowledged_ns=now_ns, acknowledged_by=by)
    if fault.trouble.event and not fault.trouble.latched:
        return replace(seen, state="cleared", cleared_ns=now_ns, cleared_by=by)
    return replace(seen, state="acknowledged", confirmed_ns=fault.confirmed_ns or now_ns)


def clear(fault: Fault, by: str, now_ns: int) -> Fault:
    """Return a fault that a person has cleared. Raises Conflict while its trouble is there."""
    if not fault.is_open:
        raise Conflict("The fault is cleared already.")
    if fault.present:
        raise Conflict(f"The trouble is still there: {fault.trouble.says} The fault can be cleared once it is over.")
    return replace(fault, state="cleared", cleared_ns=now_ns, cleared_by=by)
