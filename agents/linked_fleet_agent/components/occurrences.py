"""Events of components: queued by whatever thread they happen in, published by the agent's loop."""

import logging
import threading
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from functools import partial

import msgspec

from linked_fleet_agent.components.declaration import Declared
from linked_fleet_agent.wire import codec
from linked_fleet_agent.wire.components import COMPONENTS_VERSION, MAX_EVENT_BYTES, Occurrence, read_value

_log = logging.getLogger(__name__)

MAX_WAITING, MOST_AT_ONCE = 256, 8


class Occurrences:
    """The events of one run of an agent. Those that come faster than they are sent leave a gap in ``sequence``."""

    def __init__(
        self, declared: Mapping[str, Declared], incarnation: int, clocks: Callable[[], tuple[int, int]]
    ) -> None:
        self._declared, self._incarnation, self._clocks = declared, incarnation, clocks
        self._sequence, self._one = 0, threading.Lock()
        self._waiting: deque[Occurrence] = deque(maxlen=MAX_WAITING)
        for name, each in declared.items():
            each.component.emit = partial(self._happen, name)

    def due(self) -> Iterator[bytes]:
        """Yield the messages to publish now."""
        for _ in range(min(MOST_AT_ONCE, len(self._waiting))):
            yield codec.encode(self._waiting.popleft())

    def close(self) -> None:
        for each in self._declared.values():
            each.component.emit = None

    def _happen(self, component: str, event: str, data: bytes | None) -> None:
        schema = self._declared[component].said.events[event].data
        if schema is not None and data is not None:
            value, said = read_value(schema, data, MAX_EVENT_BYTES)
            if said or value is None:
                _log.warning("%s: event %s is sent without its data: %s", component, event, said or "null")
                data = None
        monotonic_ns, wall_ns = self._clocks()
        with self._one:
            self._waiting.append(
                Occurrence(
                    version=COMPONENTS_VERSION, incarnation=self._incarnation, sequence=self._sequence,
                    monotonic_ns=monotonic_ns, wall_ns=wall_ns, component=component, event=event,
                    data=msgspec.UNSET if data is None else msgspec.Raw(data),
                )
            )  # fmt: skip
            self._sequence += 1
