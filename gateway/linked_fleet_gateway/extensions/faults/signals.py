"""The troubles that one gateway sees, debounced before anything is written. Pure; times are wall nanoseconds."""

from collections.abc import Callable, Hashable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field

from linked_fleet_gateway.extensions.faults.fault import MOST_RECENT, Sight, Trouble
from linked_fleet_gateway.extensions.faults.signal import Policy, Signal

MOST_OF_ONE = 200
"""Troubles of one observed thing, such as the components of a robot; further ones are counted and left out."""
EVENT_KEPT_NS = 60 * 10**9
"""Time that an event waits to be written, by this gateway or by another one."""


@dataclass
class _Seen:
    signal: Signal
    trouble: Trouble


@dataclass
class _Happened:
    trouble: Trouble
    first_ns: int
    last_ns: int
    count: int = 0
    ids: list[str] = field(default_factory=list)


class Signals:
    """All troubles by the id of their fault. ``policy_of`` returns how a kind of fault is debounced."""

    def __init__(self, policy_of: Callable[[str], Policy]) -> None:
        self._policy_of = policy_of
        self._seen: dict[str, _Seen] = {}
        self._of: dict[Hashable, Mapping[str, Trouble]] = {}
        self._events: dict[str, _Happened] = {}
        self.left_out = 0
        """Troubles that were left out because there were too many of one thing."""

    def show(self, of: Hashable, troubles: Iterable[Trouble], now_ns: int) -> None:
        """Take the troubles that an observed thing has now: others that it had before have gone."""
        before, now = self._of.get(of, {}), self._bounded(troubles)
        for id, trouble in now.items():
            seen = self._seen.get(id)
            if seen is None:
                seen = self._seen[id] = _Seen(Signal(self._policy_of(trouble.kind)), trouble)
            seen.trouble = trouble
            seen.signal.come(now_ns)
        for id in before.keys() - now.keys():
            if id in self._seen:
                self._seen[id].signal.go(now_ns)
        if now:
            self._of[of] = now
        else:
            self._of.pop(of, None)

    def _bounded(self, troubles: Iterable[Trouble]) -> dict[str, Trouble]:
        found: dict[str, Trouble] = {}
        for each in troubles:
            if len(found) >= MOST_OF_ONE:
                self.left_out += 1
                break
            found[each.id] = each
        return found

    def happen(self, trouble: Trouble, id: str, now_ns: int) -> None:
        """Take an event, which has a unique id and no end."""
        held = self._events.setdefault(trouble.id, _Happened(trouble, now_ns, now_ns))
        held.trouble, held.last_ns = trouble, now_ns
        held.count += 1
        held.ids = [*held.ids, id][-MOST_RECENT:]

    def has(self, id: str) -> bool:
        """Return True if the trouble of a fault is observed here."""
        return id in self._seen

    def sights(self, now_ns: int) -> Iterator[tuple[str, Sight]]:
        """Yield what is to be believed of each trouble. One that is over is yielded once, and forgotten."""
        for id, seen in list(self._seen.items()):
            signal = seen.signal
            verdict = signal.judge(now_ns)
            yield id, Sight(seen.trouble, verdict, signal.present, signal.began_ns, signal.last_ns, signal.count)
            if verdict == "absent":
                del self._seen[id]
        for id, held in self._events.items():
            yield (
                id,
                Sight(held.trouble, "confirmed", True, held.first_ns, held.last_ns, held.count, tuple(held.ids)),
            )

    def written(self, id: str, sight: Sight) -> None:
        """Forget the events that a sight has told of, which are recorded."""
        held = self._events.get(id)
        if held is None or not sight.trouble.event:
            return
        held.count -= sight.count
        held.ids = [each for each in held.ids if each not in sight.events]
        if held.count <= 0:
            del self._events[id]

    def forget_old_events(self, now_ns: int) -> None:
        """Forget events that some gateway must have recorded by now."""
        for id, held in list(self._events.items()):
            if now_ns - held.last_ns > EVENT_KEPT_NS:
                del self._events[id]
