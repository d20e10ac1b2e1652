"""The components of one robot, as its agent has them: declarations, values, events and the requests of actions."""

import logging
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from typing import Any

import msgspec

from linked_fleet_agent.components.component import Component
from linked_fleet_agent.components.declaration import Declared, Task, declare
from linked_fleet_agent.components.occurrences import Occurrences
from linked_fleet_agent.components.operations import MAX_RUNNING, Operations
from linked_fleet_agent.components.readings import Readings
from linked_fleet_agent.components.schemas import DeclarationError
from linked_fleet_agent.wire.components import (
    MAX_INPUT_BYTES,
    MAX_SAMPLE_BYTES,
    Operate,
    read_declarations,
    read_value,
)
from linked_fleet_agent.wire.messages import Refused

_log = logging.getLogger(__name__)


def declarations_of(components: Iterable[Component], links: Collection[str], joints: Collection[str]) -> list[Declared]:
    """Return the declarations of the components of a robot. Raises DeclarationError for what gateways would refuse."""
    declared = [declare(each) for each in components]
    _, refused = read_declarations(encoded(declared) or b"[]", links, joints)
    if refused:
        raise DeclarationError(refused[0])
    return declared


def encoded(declared: Sequence[Declared]) -> bytes:
    """Return ``components`` of a description; nothing if there are none."""
    return msgspec.json.encode([each.said for each in declared]) if declared else b""


_FINISHED = Component.unfinished


class Host:
    """The components of one run of an agent; ``clocks`` returns its monotonic and wall time in nanoseconds."""

    def __init__(self, declared: Sequence[Declared], incarnation: int, clocks: Callable[[], tuple[int, int]]) -> None:
        self._declared = {each.said.name: each for each in declared}
        self._clocks = clocks
        components = {name: each.component for name, each in self._declared.items()}
        self._ticking = {name: each for name, each in components.items() if type(each).on_tick is not Component.on_tick}
        self._resuming = {name: each for name, each in components.items() if type(each).unfinished is not _FINISHED}
        self._failing = dict[str, str]()
        self.operations = Operations()
        self._readings = Readings(declared, incarnation, lambda: clocks()[0])
        self._occurrences = Occurrences(self._declared, incarnation, clocks)

    def __bool__(self) -> bool:
        return bool(self._declared)

    def tick(self, now_s: float) -> None:
        """Let components do what they do in each tick. While one cannot, nothing may move."""
        for name, component in self._ticking.items():
            try:
                component.on_tick(now_s)
            except Exception as error:  # noqa: BLE001 - a component may raise whatever its hardware library does
                if name not in self._failing:
                    _log.exception("%s: what it does in each tick has failed", name)
                self._failing[name] = f"it fails: {error or type(error).__name__}"
            else:
                if self._failing.pop(name, ""):
                    _log.warning("%s: it works again", name)

    def unfinished(self) -> Iterator[tuple[str, str, Task]]:
        """Yield the runs that earlier agents have begun and that go on: id, name and task of their action."""
        for name, component in self._resuming.items():
            for action, id in component.unfinished():
                task = self._declared[name].tasks[action]
                if task.resume is not None:
                    yield id, f"{name}.{action}", task

    def values_due(self, now_ns: int, wall_ns: int) -> bytes | None:
        """Return the message with the values that have changed, or None."""
        return self._readings.due(now_ns, wall_ns)

    def events_due(self) -> Iterator[bytes]:
        return self._occurrences.due()

    def values(self) -> bytes:
        """Return the reply to a query for all values."""
        return self._readings.everything(*self._clocks())

    @property
    def prevents_motion(self) -> str:
        """A sentence why nothing must move now, or an empty string."""
        for name, declared in self._declared.items():
            if why := self._failing.get(name) or declared.component.prevents_motion:
                return f"{name}: {why}"
        return ""

    def close(self) -> None:
        self._readings.close()
        self._occurrences.close()

    def task_of(self, operate: Operate) -> Task | Refused:
        """Return what a request is for, or its refusal."""
        declared = self._declared.get(operate.component)
        if declared is None:
            known = ", ".join(self._declared) or "none"
            return _refused(operate, f"this robot has no component {operate.component!r}; it has {known}")
        if bool(operate.action) == bool(operate.property):
            return _refused(operate, "a request names either an action or a property")
        tasks, word = (declared.tasks, "action") if operate.action else (declared.setters, "property that can be set,")
        task = tasks.get(operate.action or operate.property)
        if task is None:
            named = f"{operate.component} has no {word} {operate.action or operate.property!r}"
            return _refused(operate, f"{named}; it has {', '.join(tasks) or 'none'}")
        if operate.stream is True and task.declared.stream is None:
            return _refused(operate, f"{operate.component}.{operate.action or operate.property} takes no stream")
        return task

    def input_of(self, operate: Operate, task: Task) -> dict[str, Any] | Refused:
        """Return the input of a request by parameter, or its refusal."""
        if len(bytes(operate.input)) > MAX_INPUT_BYTES:
            return _input(operate, f"it has {len(bytes(operate.input))} bytes; {MAX_INPUT_BYTES} is the maximum")
        if operate.property:
            schema = self._declared[operate.component].said.properties[operate.property].schema
            value, said = read_value(schema, operate.input, MAX_INPUT_BYTES)
            if said or value is None:
                return _input(operate, said or "null is no value")
            found = _decoded(task, b'{"value":' + bytes(operate.input) + b"}")
        elif task.input is None:
            empty = bytes(operate.input).strip() in (b"null", b"{}", b"")
            return {} if empty else _input(operate, "this action has no input")
        else:
            payload = b"{}" if bytes(operate.input).strip() == b"null" else bytes(operate.input)
            found = _read(task, payload, MAX_INPUT_BYTES)
        return _input(operate, found) if isinstance(found, str) else found

    def reader_of(self, task: Task) -> Callable[[bytes], dict[str, Any] | None]:
        """Return the function that reads inputs of a stream, and returns None for one that violates the schema."""

        def read(payload: bytes) -> dict[str, Any] | None:
            found = _read(task, payload, MAX_SAMPLE_BYTES)
            return None if isinstance(found, str) else found

        return read

    def busy(self, operate: Operate) -> Refused | None:
        """Return the refusal of a request that there is no room for, or None."""
        if len(self.operations) < MAX_RUNNING:
            return None
        return Refused(operate.id, "fault", f"{MAX_RUNNING} actions of this robot are running, and no more may")


def _read(task: Task, payload: bytes, most_bytes: int) -> dict[str, Any] | str:
    """Return the input of an action by parameter, or a sentence about what is wrong with it."""
    assert task.declared.input is not None
    value, said = read_value(task.declared.input, payload, most_bytes)
    if said or value is None:
        return said or "null is no input"
    return _decoded(task, payload)


def _decoded(task: Task, payload: bytes) -> dict[str, Any] | str:
    assert task.input is not None
    try:
        given = msgspec.json.decode(payload, type=task.input)
    except msgspec.ValidationError as error:
        return str(error)
    return {name: getattr(given, name) for name in given.__struct_fields__}


def _refused(operate: Operate, reason: str) -> Refused:
    return Refused(operate.id, "unknown-action", reason[:1024])


def _input(operate: Operate, reason: str) -> Refused:
    return Refused(operate.id, "input", f"the input is refused: {reason}"[:1024])
