"""The present values and events of the components of one robot. Times in nanoseconds.

A value is unknown until it was heard in the present run of the agent, and when nothing has been heard of its component
for ``stale_s`` of the agent's own clock.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from msgspec import UNSET

from linked_fleet_agent.wire.codec import WireError
from linked_fleet_agent.wire.components import (
    MAX_EVENT_BYTES,
    Component,
    Measured,
    Occurrence,
    Values,
    read_value,
)
from linked_fleet_state.observation import Observation

Change = tuple[str, str]
"""Names of a component, and of a property or event of it; the second is empty if anything else has changed."""
_UNKNOWN = Observation((math.nan,), None)


@dataclass(frozen=True)
class Happened:
    """The last occurrence of an event, and the number of occurrences in this run of the agent."""

    count: int
    wall_ns: int
    data: Any = None


@dataclass
class ComponentState:
    """The state of one component. ``counter`` is the ``sequence`` of the last message that changed it."""

    declared: Component
    values: dict[str, Any] = field(default_factory=dict)
    observations: dict[str, Observation] = field(default_factory=dict)
    times_ns: dict[str, int] = field(default_factory=dict)
    """Wall time of the agent at which each value changed."""
    events: dict[str, Happened] = field(default_factory=dict)
    counters: dict[str, int] = field(default_factory=dict)
    fault: str = ""
    at_ns: int = 0
    stale: bool = False

    def value(self, name: str) -> Any:
        """Return the JSON value of a property; None is unknown."""
        return self.values.get(name)

    def observation(self, name: str) -> Observation:
        """Return the observation of a property that is a number. It is the same object until the value changes."""
        return self.observations.get(name, _UNKNOWN)

    @property
    def counter(self) -> int:
        return max(self.counters.values(), default=0)

    def measure(self, said: Measured, sequence: int, wall_ns: int) -> tuple[list[str], list[str]]:
        """Take what a message says. Return what has changed, and a sentence for each value that is refused."""
        changed, refused = list[str](), list[str]()
        if said.fault != self.fault:
            self.fault = said.fault
            changed.append("")
        self.at_ns, self.stale = said.at_ns, False
        for name, raw in said.values.items():
            declared = self.declared.properties.get(name)
            if declared is None:
                refused.append(f"component {self.declared.name!r} declares no property {name!r}")
                continue
            value, problem = read_value(declared.schema, raw)
            if problem:
                refused.append(f"{name!r} of component {self.declared.name!r} is refused: {problem}")
            if self._set(name, value, sequence, wall_ns):
                changed.append(name)
        return changed, refused

    def _set(self, name: str, value: Any, sequence: int, wall_ns: int) -> bool:
        if name in self.values and self.values[name] == value and type(self.values[name]) is type(value):
            return False
        self.values[name], self.times_ns[name], self.counters[name] = value, wall_ns, sequence
        if self.declared.properties[name].schema.type == "number":
            self.observations[name] = Observation((math.nan if value is None else float(value),), wall_ns, sequence)
        return True

    def assume(self, values: Mapping[str, tuple[Any, int]], events: Mapping[str, Happened], fault: str) -> None:
        """Take the values, each with its time, the events and the fault of another copy of this component."""
        for name, (value, wall_ns) in values.items():
            if name in self.declared.properties and (self.times_ns.get(name) != wall_ns or self.value(name) != value):
                self._set(name, value, 0, wall_ns)
        self.events, self.fault = dict(events), fault

    def expire(self, sequence: int) -> list[str]:
        """Make all values unknown. Return the names of those that were known."""
        known = [name for name, value in self.values.items() if value is not None]
        for name in known:
            self._set(name, None, sequence, self.times_ns[name])
        self.stale = True
        return known


class RobotState:
    """The components of one robot in one run of its agent."""

    def __init__(self, components: Sequence[Component], incarnation: int) -> None:
        self.components = {each.name: ComponentState(each) for each in components}
        self.incarnation = incarnation
        self.sequence: int | None = None
        """The ``sequence`` of the last message with values; None before the first one."""
        self.complete = False
        """False if a message was missed, until all values have been asked for."""
        self.changes = 0
        """Number of times at which something has changed in this run."""

    def restart(self, incarnation: int) -> None:
        """Forget all values, because the agent runs anew."""
        self.__init__([each.declared for each in self.components.values()], incarnation)  # type: ignore[misc]

    def hear(self, said: Values) -> tuple[list[Change], list[str]]:
        """Take a message with values that have changed. Return the changes, and what is refused in sentences.

        A message of another run, and one that is late, changes nothing.
        """
        if said.incarnation != self.incarnation or (self.sequence is not None and said.sequence <= self.sequence):
            return [], []
        if self.sequence is None or said.sequence != self.sequence + 1:
            self.complete = False
        self.sequence = said.sequence
        return self._take(said.components, said.sequence, said.wall_ns)

    def hear_all(self, said: Values) -> tuple[list[Change], list[str]]:
        """Take the reply to a query, which has all values. One that is older than the last message changes nothing."""
        if said.incarnation != self.incarnation or (self.sequence is not None and said.sequence < self.sequence):
            return [], []
        self.sequence, self.complete = said.sequence, True
        return self._take(said.components, said.sequence, said.wall_ns)

    def _take(self, components: Mapping[str, Measured], sequence: int, wall_ns: int) -> tuple[list[Change], list[str]]:
        changes, refused = list[Change](), list[str]()
        for name, measured in components.items():
            if (state := self.components.get(name)) is None:
                continue  # one that was refused when it was declared
            changed, problems = state.measure(measured, sequence, wall_ns)
            changes += [(name, each) for each in changed]
            refused += problems
        self.changes += bool(changes)
        return changes, refused

    def happen(self, said: Occurrence) -> Change | None:
        """Take an event. Return the change, or None. Raises WireError for data that are not what is declared."""
        state = self.components.get(said.component)
        if said.incarnation != self.incarnation or state is None:
            return None
        declared = state.declared.events.get(said.event)
        if declared is None:
            raise WireError(f"component {said.component!r} declares no event {said.event!r}")
        before = state.events.get(said.event)
        data, problem = None, ""
        if declared.data is not None and said.data is not UNSET:
            data, problem = read_value(declared.data, said.data, MAX_EVENT_BYTES)
        if problem:
            raise WireError(f"the data of event {said.event!r} of component {said.component!r} are refused: {problem}")
        self.changes += 1
        state.events[said.event] = Happened(1 if before is None else before.count + 1, said.wall_ns, data)
        return said.component, said.event

    def expire(self, now_ns: int) -> Iterator[Change]:
        """Make the values unknown of which nothing was heard for too long; ``now_ns`` by the clock of the agent."""
        for name, state in self.components.items():
            if not state.stale and state.values and now_ns - state.at_ns > state.declared.stale_s * 1e9:
                self.changes += 1
                yield from ((name, each) for each in (*state.expire(self.sequence or 0), ""))
