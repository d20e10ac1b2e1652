"""The values of components that go into a segment: those that were known before, and as many as there is room for.

A segment has what was known when it began, so that it answers alone what held at a time. The values of one robot have
a part of it, so that a talkative component does not cost the history of other robots.
"""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace

from linked_fleet_gateway.extensions.history.segment import EVENT, HELD, PLACEMENTS, UNKNOWN, VALUE, WORLD, Said

SHARE = 512
"""The values of a robot take at most this part of all that may be kept in a segment."""
_OF_ROW = 64
"""Bytes that a value takes beside its path and its JSON."""


def size_in_file(said: Said) -> int:
    """Return the bytes that a value takes, about."""
    return len(said.json) + len(said.path) + _OF_ROW


class KeptValues:
    """The last value of each property, and the room in the present segment. ``lost`` is called with what has none."""

    def __init__(self, most_bytes: int, lost: Callable[[Said], None]) -> None:
        self._most_bytes, self._lost = most_bytes / SHARE, lost
        self.holds_known = False
        """True if the present segment has what was known when it began."""
        self._held: dict[str, dict[str, Said]] = {}
        self._written: dict[str, int] = {}
        self._crowded: dict[str, set[str]] = {}
        """Properties whose values had no room, by robot."""

    def begin_segment(self) -> None:
        """There is room again."""
        self.holds_known = False
        self._written.clear()
        self._crowded.clear()

    def admitted(self, values: Sequence[Said]) -> list[Said]:
        """Return what is to be written now."""
        known = list[Said]()
        if not self.holds_known:
            known = [replace(each, kind=HELD) for held in self._held.values() for each in held.values()]
        self._hold(values)
        return list(self._with_room([*known, *values]))

    def not_written(self, values: Sequence[Said], can_be: bool) -> None:
        """Write what is known once more. ``can_be``: False if something in the values can never be written."""
        self.holds_known = False
        self._hold(values)
        for each in () if can_be else values:
            self._held.get(each.robot, {}).pop(each.path, None)

    def forget(self, robot: str) -> None:
        self._held.pop(robot, None)
        self._held.get(WORLD, {}).pop(PLACEMENTS + robot, None)

    def _hold(self, values: Iterable[Said]) -> None:
        for each in values:
            if each.kind == VALUE:
                self._held.setdefault(each.robot, {})[each.path] = each

    def _with_room(self, values: Iterable[Said]) -> Iterator[Said]:
        """Yield the values for which there is room. The first one of a property for which there is none is unknown."""
        for each in values:
            size, written = size_in_file(each), self._written.get(each.robot, 0)
            crowded = self._crowded.setdefault(each.robot, set())
            if written + size <= self._most_bytes:
                self._written[each.robot] = written + size
                crowded.discard(each.path)
                yield each
                continue
            self._lost(each)
            if each.kind != EVENT and each.path not in crowded:
                crowded.add(each.path)
                yield replace(each, json=UNKNOWN)
