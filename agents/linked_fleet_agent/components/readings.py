"""The values of a robot's components, read beside its control loop, and the messages about them.

A message has the values that have changed since the one before. Times are in nanoseconds and are passed in.
"""

import logging
import threading
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import msgspec

from linked_fleet_agent.components.declaration import Declared
from linked_fleet_agent.wire import codec
from linked_fleet_agent.wire.components import COMPONENTS_VERSION, MAX_VALUES_BYTES, Measured, Values, read_value

_log = logging.getLogger(__name__)

UNKNOWN = b"null"
_RENEWED = 3.0
"""Messages about a component while nothing changes, in each ``stale_s``."""


class _Round(NamedTuple):
    """The values of a component, read at one time, and why some of them are unknown."""

    at_ns: int
    values: Mapping[str, bytes]
    fault: str


class _Reader:
    """Reads one component: on the event loop, or in a thread that waits for its next turn."""

    def __init__(self, declared: Declared, monotonic_ns: Callable[[], int]) -> None:
        self.name, self._declared, self._monotonic_ns = declared.said.name, declared, monotonic_ns
        self._period_ns = int(1e9 / declared.said.rate_hz)
        self._renewed_ns = int(declared.said.stale_s * 1e9 / _RENEWED)
        self.due_ns, self._told_ns = 0, -self._renewed_ns
        self.rounds: deque[_Round] = deque(maxlen=1)
        self._checked: dict[str, tuple[bytes, bytes, str]] = {}
        self._turn, self._ended = threading.Event(), False
        self.values: dict[str, bytes] = dict.fromkeys(declared.reads, UNKNOWN)
        self.at_ns, self.fault = 0, ""
        self._thread: threading.Thread | None = None

    def changes(self, now_ns: int) -> Measured | None:
        """Begin to read if it is time. Return what is new since the last message, or None."""
        if now_ns >= self.due_ns:
            self.due_ns = now_ns + self._period_ns
            self._read()
        if not self.rounds:
            return None
        found = self.rounds.pop()
        changed = {name: each for name, each in found.values.items() if each != self.values[name]}
        if not changed and found.fault == self.fault and now_ns - self._told_ns < self._renewed_ns:
            self.at_ns = found.at_ns
            return None
        self._told_ns, self.at_ns = now_ns, found.at_ns
        self.values.update(changed)
        if found.fault and found.fault != self.fault:
            _log.warning("%s: %s", self.name, found.fault)
        self.fault = found.fault
        return Measured(at_ns=self.at_ns, values=_raw(changed), fault=self.fault)

    @property
    def everything(self) -> Measured:
        return Measured(at_ns=self.at_ns, values=_raw(self.values), fault=self.fault)

    def _read(self) -> None:
        if not self._declared.component.blocking:
            self.rounds.append(self._round())
            return
        if self._thread is None:
            self._thread = threading.Thread(target=self._serve, name=f"read {self.name}", daemon=True)
            self._thread.start()
        self._turn.set()

    def _serve(self) -> None:
        while self._turn.wait() and not self._ended:
            self._turn.clear()
            self.rounds.append(self._round())

    def close(self) -> None:
        self._ended = True
        self._turn.set()

    def _round(self) -> _Round:
        at_ns = self._monotonic_ns()
        values, faults = dict[str, bytes](), list[str]()
        for name, read in self._declared.reads.items():
            try:
                values[name], said = self._conforming(name, msgspec.json.encode(read()))
            except Exception as error:  # noqa: BLE001 - a component may raise whatever its hardware library does
                values[name], said = UNKNOWN, f"{name} cannot be read: {error or type(error).__name__}"
            faults += [said] if said else []
        return _Round(at_ns, values, faults[0][:1024] if faults else "")

    def _conforming(self, name: str, payload: bytes) -> tuple[bytes, str]:
        """Return the value, or unknown and why it is not what is declared."""
        before = self._checked.get(name)
        if before is None or before[0] != payload:
            _, said = read_value(self._declared.said.properties[name].schema, payload)
            fault = f"{name} is not what is declared: {said}" if said else ""
            before = self._checked[name] = payload, UNKNOWN if said else payload, fault
        return before[1], before[2]


def _raw(values: Mapping[str, bytes]) -> dict[str, msgspec.Raw]:
    return {name: msgspec.Raw(each) for name, each in values.items()}


class Readings:
    """The values of all components of one run of an agent."""

    def __init__(self, declared: Sequence[Declared], incarnation: int, monotonic_ns: Callable[[], int]) -> None:
        self._readers = [_Reader(each, monotonic_ns) for each in declared]
        self._incarnation, self._sequence = incarnation, 0

    def due(self, now_ns: int, wall_ns: int) -> bytes | None:
        """Return the message to publish now, or None."""
        awake = [each for each in self._readers if each.rounds or now_ns >= each.due_ns]
        said = {each.name: found for each in awake if (found := each.changes(now_ns)) is not None}
        if not said:
            return None
        self._sequence += 1
        return self._message(said, now_ns, wall_ns)

    def everything(self, now_ns: int, wall_ns: int) -> bytes:
        """Return the reply to a query."""
        return self._message({each.name: each.everything for each in self._readers}, now_ns, wall_ns)

    @property
    def fault(self) -> str:
        """A sentence about the first component that cannot be read, or an empty string."""
        return next((f"{each.name}: {each.fault}" for each in self._readers if each.fault), "")

    def close(self) -> None:
        for each in self._readers:
            each.close()

    def _message(self, said: dict[str, Measured], now_ns: int, wall_ns: int) -> bytes:
        message = Values(
            version=COMPONENTS_VERSION, incarnation=self._incarnation, sequence=self._sequence, monotonic_ns=now_ns,
            wall_ns=wall_ns, components=said,
        )  # fmt: skip
        payload = codec.encode(message)
        if len(payload) <= MAX_VALUES_BYTES:
            return payload
        reason = f"its values have {len(payload)} bytes together; {MAX_VALUES_BYTES} is the maximum of a robot"
        blank = {name: Measured(at_ns=each.at_ns, values=_raw(dict.fromkeys(each.values, UNKNOWN)), fault=reason)
                 for name, each in said.items()}  # fmt: skip
        return codec.encode(msgspec.structs.replace(message, components=blank))
