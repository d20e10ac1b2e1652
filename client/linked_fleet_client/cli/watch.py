"""Command ``watch``: prints values as they change."""

import contextlib
import itertools
import queue
import sys
import threading
import time
from collections.abc import Generator, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import click

from linked_fleet_client.cli import output
from linked_fleet_client.cli.description import find_at
from linked_fleet_client.cli.options import Session, add_common_options, seconds, units, watched_paths
from linked_fleet_client.errors import ClientError
from linked_fleet_client.fleet import Observable, Thing
from linked_fleet_client.live import Change, Feed
from linked_fleet_client.reading import Reading
from linked_fleet_client.resource import Resource

_CLEAR = "\x1b[H\x1b[J"
_WAITING = 64
_END_S = 2.0


@dataclass(frozen=True)
class Row:
    path: str
    reading: Reading
    missed: bool


@click.command(short_help="Print values as they change.")
@click.argument("paths", nargs=-1, required=True, metavar="PATH...", shell_complete=watched_paths)
@click.option("--count", type=click.IntRange(min=1), help="End after so many changes.")
@click.option("--interval", type=seconds, help="At least so many seconds between two changes.")
@click.option("--seconds", type=seconds, help="End after so many seconds.")
@units
@add_common_options
@click.pass_obj
def watch(
    session: Session,
    paths: tuple[str, ...],
    units: tuple[str, ...],
    count: int | None,
    interval: float | None,
    seconds: float | None,
) -> None:
    """Print values as they change: a line each, or on a terminal a table that is updated in place."""
    shown = _Screen(units) if sys.stdout.isatty() and not session.json else _Lines(units, session.json)
    with session.fleet() as fleet:
        watched = {path: find_at(fleet, path) for path in paths}
        feeds = {
            path: _observed(here).subscribe(interval_s=interval, timeout_s=seconds) for path, here in watched.items()
        }
        with contextlib.closing(_changes(feeds)) as changes:
            for path, change in itertools.islice(changes, count):
                shown.show(list(_rows(path, watched[path], change)))


def _observed(here: Resource) -> Observable:
    return here if isinstance(here, Observable) else Observable(here.web, here.iri)


def _changes(feeds: Mapping[str, Feed]) -> Generator[tuple[str, Change], None, None]:
    """Yield the changes of all feeds, each read in a thread; closing the generator ends them."""
    news: queue.Queue[tuple[str, Change] | ClientError | None] = queue.Queue(_WAITING + len(feeds))
    threads = [threading.Thread(target=_follow, args=(*each, news), daemon=True) for each in feeds.items()]
    for thread in threads:
        thread.start()
    try:
        running = len(threads)
        while running:
            said = news.get()
            if isinstance(said, ClientError):
                raise said
            if said is None:
                running -= 1
            else:
                yield said
    finally:
        for feed in feeds.values():
            feed.close()
        _wait_for(threads, news)


def _follow(path: str, feed: Feed, news: "queue.Queue[Any]") -> None:
    try:
        for change in feed:
            news.put((path, change))
        news.put(None)
    except ClientError as error:
        news.put(error)


def _wait_for(threads: list[threading.Thread], news: "queue.Queue[Any]") -> None:
    """Wait until all threads have ended. One that is connecting may take longer and ends by itself."""
    deadline = time.monotonic() + _END_S
    while any(thread.is_alive() for thread in threads) and time.monotonic() < deadline:
        with contextlib.suppress(queue.Empty):
            news.get(timeout=0.02)  # makes room for threads that wait for the queue


def _rows(path: str, here: Resource, change: Change) -> Iterator[Row]:
    if not isinstance(here, Thing):
        yield Row(path, change.reading, change.missed)
        return
    presence = here.presence_in(change.document)
    if presence:
        yield Row(path, Reading({"presence": presence}, ()), change.missed)
    for prop in here.properties_in(change.document).with_loaded_names():
        yield Row(output.path_of(path, prop.name), prop.reading_in(change.document), change.missed)


class _Lines:
    """Prints a line for each value that differs from the last one."""

    def __init__(self, units: Sequence[str], as_json: bool) -> None:
        self.units, self.as_json = units, as_json
        self.before: dict[str, dict[str, Any]] = {}

    def show(self, rows: list[Row]) -> None:
        for row in rows:
            values = {key: output.value_text(value, self.units) for key, value in row.reading.values.items()}
            if self.before.get(row.path) == values:
                continue
            self.before[row.path] = values
            print(self._line(row), flush=True)

    def _line(self, row: Row) -> str:
        now = time.strftime("%H:%M:%S")
        if self.as_json:
            values = output.reading(row.reading, self.units)
            return output.as_json({"path": row.path, "values": values, "missed": row.missed})
        gap = "  (others in between)" if row.missed else ""
        return output.clean(f"{now}  {row.path}  {output.one_line(row.reading, self.units)}{gap}")


class _Screen:
    """A table of the latest values, redrawn at every change."""

    def __init__(self, units: Sequence[str]) -> None:
        self.units = units
        self.rows: dict[str, tuple[str, str]] = {}

    def show(self, rows: list[Row]) -> None:
        for row in rows:
            if row.reading.values:
                self.rows[row.path] = (output.one_line(row.reading, self.units), time.strftime("%H:%M:%S"))
        lines = [[path, value, at] for path, (value, at) in self.rows.items()]
        sys.stdout.write(_CLEAR + output.table(lines, ("PATH", "VALUE", "AT")) + "\n")
        sys.stdout.flush()
