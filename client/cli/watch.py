"""``watch``: values as they change."""

import queue
import sys
import threading
import time
from argparse import Namespace
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from client.cli import show
from client.cli.look import found_at
from client.errors import ClientError
from client.fleet import Fleet
from client.live import Change
from client.reading import Reading
from client.resource import Resource
from client.thing import Observable, Thing

_CLEAR = "\x1b[H\x1b[J"
_WAITING = 64


@dataclass(frozen=True)
class Row:
    path: str
    reading: Reading
    missed: bool


def watch(fleet: Fleet, options: Namespace) -> int:
    """One line for each value that changes; on a terminal a table that is kept fresh."""
    watched = [(path, found_at(fleet, path)) for path in options.paths]
    news: queue.Queue[tuple[str, Change] | ClientError | None] = queue.Queue(_WAITING)
    for path, here in watched:
        threading.Thread(target=_follow, args=(path, here, options, news), daemon=True).start()
    shown = _Screen(options) if sys.stdout.isatty() and not options.json else _Lines(options)
    here_of = dict(watched)
    changes, open_feeds = 0, len(watched)
    while open_feeds and (options.count is None or changes < options.count):
        said = news.get()
        if isinstance(said, ClientError):
            raise said
        if said is None:
            open_feeds -= 1
            continue
        path, change = said
        changes += 1
        shown.show(list(_rows(path, here_of[path], change)))
    return 0


def _follow(path: str, here: Resource, options: Namespace, news: "queue.Queue[Any]") -> None:
    observed = here if isinstance(here, Observable) else Observable(here.web, here.iri)
    try:
        for change in observed.subscribe(interval_s=options.interval, timeout_s=options.seconds):
            news.put((path, change))
        news.put(None)
    except ClientError as error:
        news.put(error)


def _rows(path: str, here: Resource, change: Change) -> Iterator[Row]:
    if not isinstance(here, Thing):
        yield Row(path, change.reading, change.missed)
        return
    presence = here.presence_in(change.document)
    if presence:
        yield Row(path, Reading({"presence": presence}, ()), change.missed)
    for prop in here.properties_in(change.document).introduced():
        yield Row(show.path_of(path, prop.name), prop.within(change.document), change.missed)


class _Lines:
    """A line for each value that is another than before."""

    def __init__(self, options: Namespace) -> None:
        self.options = options
        self.before: dict[str, dict[str, Any]] = {}

    def show(self, rows: list[Row]) -> None:
        for row in rows:
            values = {key: show.said(value, self.options.unit) for key, value in row.reading.values.items()}
            if self.before.get(row.path) == values:
                continue
            self.before[row.path] = values
            print(self._line(row), flush=True)

    def _line(self, row: Row) -> str:
        now = time.strftime("%H:%M:%S")
        if self.options.json:
            values = show.reading(row.reading, self.options.unit)
            return show.as_json({"path": row.path, "values": values, "missed": row.missed})
        gap = "  (others in between)" if row.missed else ""
        return show.clean(f"{now}  {row.path}  {show.brief(row.reading, self.options.unit)}{gap}")


class _Screen:
    """A table of the latest values, painted anew at every change."""

    def __init__(self, options: Namespace) -> None:
        self.options = options
        self.rows: dict[str, tuple[str, str]] = {}

    def show(self, rows: list[Row]) -> None:
        for row in rows:
            if row.reading.values:
                self.rows[row.path] = (show.brief(row.reading, self.options.unit), time.strftime("%H:%M:%S"))
        lines = [[path, value, at] for path, (value, at) in self.rows.items()]
        sys.stdout.write(_CLEAR + show.table(lines, ("PATH", "VALUE", "AT")) + "\n")
        sys.stdout.flush()
