"""Messages to people about faults, by mail or chat: what is told, and when. Pure; times are wall nanoseconds.

However many faults there are, and however often they come, there is one message a minute at most, and one about a
fault in its period.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from linked_fleet_gateway.extensions.faults.fault import SEVERITIES, Fault, Severity

LEAST_S = 60.0
"""Time between two messages."""
MOST_LISTED = 20


@dataclass(frozen=True)
class Message:
    """A message, and the ids of the faults that it tells of."""

    title: str
    text: str
    faults: tuple[str, ...]


@dataclass(frozen=True)
class Telling:
    """Selects what people are told of: confirmed faults of this severity or worse, each once in ``period_s``."""

    least: Severity
    period_s: float
    root: str
    """The address of the fleet, which messages link."""

    def message(self, faults: Mapping[str, Fault], last_ns: int, now_ns: int) -> Message | None:
        """Return the message that is due; None if none is. ``last_ns`` is when the last one was sent."""
        if now_ns - last_ns < LEAST_S * 1e9:
            return None
        due = [(id, fault) for id, fault in faults.items() if self._is_due(fault, now_ns)]
        due.sort(key=lambda each: (-SEVERITIES.index(each[1].trouble.severity), each[1].since_ns, each[0]))
        return self._about(due) if due else None

    def _is_due(self, fault: Fault, now_ns: int) -> bool:
        is_bad = SEVERITIES.index(fault.trouble.severity) >= SEVERITIES.index(self.least)
        return fault.needs_attention and is_bad and now_ns - fault.told_ns >= self.period_s * 1e9

    def _about(self, due: Sequence[tuple[str, Fault]]) -> Message:
        first, count = due[0][1].trouble, len(due)
        title = f"{first.severity}: {first.says}" if count == 1 else f"{count} faults, the worst: {first.says}"
        lines = [f"{each.trouble.severity}, {each.trouble.place}: {each.trouble.says}" for _, each in due[:MOST_LISTED]]
        more = [f"and {count - MOST_LISTED} more"] if count > MOST_LISTED else []
        return Message(title[:200], "\n".join([*lines, *more, f"{self.root}/faults"]), tuple(id for id, _ in due))
