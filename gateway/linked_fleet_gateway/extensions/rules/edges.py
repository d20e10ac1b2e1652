"""Changes of the fleet since the last look, and of the rows of a pattern."""

import asyncio
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from hashlib import blake2b

from pyoxigraph import BlankNode

from linked_fleet_gateway.api import Resource, robot_path
from linked_fleet_gateway.faces import Reading
from linked_fleet_gateway.serving import Live
from linked_fleet_rdf.graph import Term

LOOK_S = 0.02
"""Time in which frames are collected before a check."""


class ChangeNotifier:
    """Calls ``tell`` after changes of the fleet, at most once every ``LOOK_S``. It observes nothing while closed."""

    def __init__(self, live: Live, tell: Callable[[], None]) -> None:
        self._live, self._tell = live, tell
        self._readings: dict[str, Reading] = {}
        self._moved: set[str] = set()
        self._other = False
        self._looking: asyncio.TimerHandle | None = None

    def open(self) -> None:
        self._live.add_listener(self._hear)

    def close(self) -> None:
        self._live.remove_listener(self._hear)
        self._readings.clear()
        if self._looking is not None:
            self._looking.cancel()
            self._looking = None

    def _hear(self, robot: str | None) -> None:
        if robot is None:
            self._other = True
        else:
            self._moved.add(robot)
        if self._looking is None:
            self._looking = asyncio.get_running_loop().call_later(LOOK_S, self._look)

    def _look(self) -> None:
        self._looking = None
        moved, self._moved = self._moved, set()
        other, self._other = self._other, False
        tree = self._live.tree("")
        for name in moved:
            found = tree.resolve(robot_path(name))
            if isinstance(found, Resource):
                before, now = self._readings.get(name), found.source.read(True)
                self._readings[name] = now
                other |= before is None or not now.equals(before)
        if other:
            self._tell()


Row = Mapping[str, Term]

MOST_ROWS = 256
MOST_CHARACTERS = 8_192
"""Most characters in the terms of one row, because firings show them."""


class UnusableResult(ValueError):  # noqa: N818 -- named like the other outcomes
    """The result of a condition cannot be compared with the previous one; the message is for the rule's author."""


@dataclass(frozen=True)
class Edge:
    """The rows that started to hold, by key in a stable order, and the keys of those that ceased to hold."""

    began: tuple[tuple[str, Row], ...]
    ended: tuple[str, ...]

    def __bool__(self) -> bool:
        return bool(self.began or self.ended)


def rows_by_key(rows: Sequence[Row], told_apart_by: Collection[str] = ()) -> dict[str, Row]:
    """Return the rows by key, in the order of their terms.

    The key consists of the variables ``told_apart_by`` (all if empty); the first row of each key is kept. Raises
    UnusableResult.
    """
    if len(rows) > MOST_ROWS:
        raise UnusableResult(f"its condition has more than {MOST_ROWS} answers")
    written = sorted(((_written(row), row) for row in rows), key=lambda pair: pair[0])
    found: dict[str, Row] = {}
    for _, row in written:
        found.setdefault(_key(row, told_apart_by or row), row)
    return found


def edge(before: Collection[str], now: Mapping[str, Row]) -> Edge:
    """Return the difference between ``before``, the keys of rows that held, and the rows ``now``."""
    began = tuple((key, row) for key, row in now.items() if key not in before)
    return Edge(began, tuple(sorted(key for key in before if key not in now)))


def ripe(
    now: Mapping[str, Row], before: Collection[str], since_s: Mapping[str, float], at_s: float, holds_for_s: float
) -> tuple[dict[str, Row], float | None]:
    """Return the rows that held before or have held for long enough, and when the next one has; None if none waits.

    ``since_s`` are the times since which rows have been there. A row that is gone meanwhile waits anew.
    """
    waiting = {key: since_s[key] + holds_for_s for key in now if key not in before}
    waiting = {key: due_s for key, due_s in waiting.items() if due_s > at_s}
    return {key: row for key, row in now.items() if key not in waiting}, min(waiting.values(), default=None)


def _written(row: Row) -> tuple[tuple[str, str], ...]:
    terms = tuple(sorted((name, str(term)) for name, term in row.items()))
    for name, term in row.items():
        if isinstance(term, BlankNode):
            raise UnusableResult(f"?{name} is a blank node, which differs in each answer: select IRIs and values")
    if sum(len(term) for _, term in terms) > MOST_CHARACTERS:
        raise UnusableResult(f"an answer of its condition has more than {MOST_CHARACTERS} characters")
    return terms


def _key(row: Row, names: Collection[str]) -> str:
    said = "\n".join(f"{name} {row.get(name, '')}" for name in sorted(names))
    return blake2b(said.encode(errors="surrogatepass"), digest_size=16).hexdigest()
