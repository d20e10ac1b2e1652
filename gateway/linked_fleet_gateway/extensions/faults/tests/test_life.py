"""The life of a fault, against a small model of it."""

from collections.abc import Callable

import pytest
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, precondition, rule
from msgspec.structs import replace

from linked_fleet_gateway.api import Conflict
from linked_fleet_gateway.extensions.faults.fault import (
    Fault,
    Severity,
    Sight,
    State,
    Trouble,
    acknowledge,
    clear,
    observe,
)
from linked_fleet_gateway.extensions.faults.signal import Verdict

PLACE = ("/panda/", ("panda",))


def sight(verdict: Verdict, now: int, *, latched: bool = False, severity: Severity = "error") -> Sight:
    return Sight(Trouble("k", *PLACE, severity, "It is broken.", latched), verdict, verdict != "absent", now, now, 1)


class Life(RuleBasedStateMachine):
    """A condition that comes and goes; ``state`` and ``there`` are the model of what people should see."""

    fault: Fault | None = None
    state: State | None = None
    there = False
    now = 0
    total = 0
    """How often the trouble came, as long as the fault is not forgotten."""

    @initialize(latched=st.booleans())
    def begin(self, latched: bool) -> None:
        self.latched = latched

    def _sees(self, verdict: Verdict) -> None:
        self.now += 1
        since = self.fault.since_ns if self.fault is not None and self.there else self.now
        seen = Sight(Trouble("k", *PLACE, "error", "x", self.latched), verdict, True, since, self.now, 1)
        self.fault = observe(self.fault, seen, self.now)

    @rule(confirmed=st.booleans())
    def appears(self, confirmed: bool) -> None:
        if not self.there:
            self.total += 1
        if self.state in (None, "cleared"):
            self.state = "confirmed" if confirmed else "raised"
        elif (self.state == "raised" and confirmed) or (self.state == "acknowledged" and not self.there):
            self.state = "confirmed"
        self._sees("confirmed" if confirmed else "raised")
        self.there = True

    @rule()
    def goes(self) -> None:
        self.now += 1
        self.fault = observe(self.fault, sight("absent", self.now, latched=self.latched), self.now)
        if self.state == "raised":
            self.state = "cleared" if self.total > 1 else None
            self.total = self.total if self.state else 0
        elif self.state in ("confirmed", "acknowledged") and not self.latched:
            self.state = "cleared"
        self.there = False

    @precondition(lambda self: self.fault is not None)
    @rule()
    def is_acknowledged(self) -> None:
        self.now += 1
        assert self.fault is not None
        if self.state in ("cleared", "acknowledged"):
            with pytest.raises(Conflict):
                acknowledge(self.fault, "ann", self.now)
            return
        self.fault, self.state = acknowledge(self.fault, "ann", self.now), "acknowledged"
        assert self.fault.acknowledged_by == "ann"

    @precondition(lambda self: self.fault is not None)
    @rule()
    def is_cleared(self) -> None:
        self.now += 1
        assert self.fault is not None
        if self.state == "cleared" or self.there:
            with pytest.raises(Conflict):
                clear(self.fault, "bob", self.now)
            return
        self.fault, self.state = clear(self.fault, "bob", self.now), "cleared"
        assert self.fault.cleared_by == "bob"

    @invariant()
    def is_as_the_model(self) -> None:
        assert (None if self.fault is None else self.fault.state) == self.state
        if self.fault is not None:
            assert self.fault.present == self.there
            assert self.fault.before + self.fault.count == self.total
            assert self.fault.is_open == (self.state != "cleared")


TestLife = Life.TestCase


def event(*ids: str, latched: bool = False, severity: Severity = "error", now: int = 1) -> Sight:
    told = Trouble("k", *PLACE, severity, "It failed.", latched, True)
    return Sight(told, "confirmed", False, now, now, len(ids), ids)


def seen(fault: Fault | None, what: Sight, now: int = 1) -> Fault:
    found = observe(fault, what, now)
    assert found is not None
    return found


def test_an_event_is_counted_once_whichever_gateways_tell_of_it() -> None:
    fault = seen(None, event("a", "b"))
    assert (fault.state, fault.count, fault.present) == ("confirmed", 2, False)
    again = seen(fault, event("b", "c"))
    assert again.count == 3
    assert seen(again, event("a", "b", "c")) == again


def test_acknowledging_clears_an_event_and_another_one_raises_it_again() -> None:
    fault = acknowledge(seen(None, event("a")), "ann", 2)
    assert (fault.state, fault.cleared_by) == ("cleared", "ann")
    again = seen(fault, event("b"), 3)
    assert (again.state, again.acknowledged_by, again.before, again.count) == ("confirmed", "", 1, 1)


def test_a_latched_event_is_acknowledged_and_then_cleared() -> None:
    fault = acknowledge(seen(None, event("a", latched=True)), "ann", 2)
    assert fault.state == "acknowledged"
    assert clear(fault, "bob", 3).state == "cleared"


@pytest.mark.parametrize("make", [sight, lambda verdict, now, severity: event("b", severity=severity, now=now)])
def test_what_becomes_worse_is_to_be_acknowledged_again(make: Callable[..., Sight]) -> None:
    first = sight("confirmed", 1, severity="warning") if make is sight else event("a", severity="warning")
    fault = acknowledge(seen(None, replaced(first, latched=True)), "ann", 2)
    assert fault.state == "acknowledged"
    assert seen(fault, make("confirmed", 3, severity="error"), 3).state == "confirmed"


def replaced(what: Sight, *, latched: bool) -> Sight:
    return replace(what, trouble=replace(what.trouble, latched=latched))


def test_all_gateways_have_the_same_id_for_a_fault() -> None:
    one, other = Trouble("k", "/panda/"), Trouble("k", "/panda/", says="in other words")
    assert one.id == other.id != Trouble("k", "/ur5/").id
