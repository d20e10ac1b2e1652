"""A segment of the history on disk: an SQLite file with the frames and values of some time, of all robots.

Frames are written one by one, so that a killed process loses those of the last batch alone, and packed into blocks when
there are enough of a robot: byte by byte of all frames one after the other, compressed. A segment has all that it takes
to understand it: names of joints and URDF. Its tables are described in README.md.
"""

import json
import sqlite3
import zlib
from collections.abc import Iterable, Iterator, Sequence
from contextlib import closing, suppress
from dataclasses import dataclass
from heapq import merge
from pathlib import Path

from linked_fleet_agent.wire.codec import layout as wire_layout
from linked_fleet_gateway.extensions.history.track import wall_ns

SUFFIX = ".sqlite"
APPLICATION_ID = 0x4C464831
"""The ``application_id`` of the file: "LFH1"."""
_FINISHED = 1
_BLOCK = 120
"""Frames in a block."""
_MOST_URDF = 64 * 2**20
_BUSY_S = 2.0
VALUE, EVENT, HELD = "value", "event", "held"
"""Kinds of what is said. A held value was known when its segment began, and has the time when it was said."""
UNKNOWN = "null"
"""The JSON of a value of which nothing is known."""
WORLD = ""
"""The robot of values that are of no robot, but of the world."""
PLACEMENTS = "placements/"
"""The path of values of the world that say where robots stood, before their names."""
_VALUES = "SELECT path, kind, said,"
_SCHEMA = f"""
PRAGMA application_id = {APPLICATION_ID};
CREATE TABLE layout (
    id INTEGER PRIMARY KEY, robot TEXT NOT NULL, joints TEXT NOT NULL, floating INTEGER NOT NULL, urdf BLOB NOT NULL,
    oldest INTEGER NOT NULL, newest INTEGER NOT NULL
);
CREATE TABLE frame (layout INTEGER, stamp INTEGER, data BLOB NOT NULL, PRIMARY KEY (layout, stamp)) WITHOUT ROWID;
CREATE TABLE block (layout INTEGER, oldest INTEGER, newest INTEGER, size INTEGER, data BLOB NOT NULL);
CREATE INDEX block_time ON block (layout, oldest);
CREATE TABLE value (robot TEXT NOT NULL, path TEXT NOT NULL, stamp INTEGER NOT NULL, kind TEXT NOT NULL, said TEXT);
CREATE INDEX value_time ON value (robot, stamp);
"""


class UnreadableSegmentError(Exception):
    """A file that cannot be read at present, such as without free file descriptors, or a locked one."""


class DamagedSegmentError(Exception):
    """A file that can never be read."""


@dataclass(frozen=True)
class Layout:
    """The meaning of the numbers in frames of a robot."""

    robot: str
    joints: tuple[str, ...]
    floating: bool
    urdf: str


@dataclass(frozen=True)
class Said:
    """A value of a component, or what came with an event of it, as JSON. ``path`` is that below the robot."""

    robot: str
    path: str
    kind: str
    json: str
    stamp_ns: int


def frame_size(layout: Layout) -> int:
    """Return the size of a frame."""
    last = wire_layout(len(layout.joints), layout.floating)[-1]
    return last.offset + 8 * last.count


Range = tuple[int, int]
"""The stamps of the oldest and the newest frame."""


class Writer:
    """A segment that grows. One thread at a time may use it. Its methods raise sqlite3.Error."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.is_single = False
        """True once it is a single file."""
        self.ranges: dict[str, Range] = {}
        self._ids: dict[Layout, int] = {}
        self._waiting: dict[int, int] = {}
        self._database = sqlite3.connect(path, timeout=_BUSY_S, isolation_level=None, check_same_thread=False)
        try:
            self._database.execute("PRAGMA journal_mode = WAL")
            self._database.execute("PRAGMA synchronous = NORMAL")
            self._database.executescript(f"BEGIN; {_SCHEMA} COMMIT;")
        except sqlite3.Error:
            self._database.close()
            raise

    def write(self, frames: Iterable[tuple[Layout, bytes]], values: Iterable[Said] = ()) -> None:
        """Write a batch, all of it or nothing."""
        database = self._database
        database.execute("BEGIN")
        try:
            for layout, found in _by_layout(frames).items():
                self._write_frames(self._id(layout), layout, found)
            rows = [(each.robot, each.path, each.stamp_ns, each.kind, each.json) for each in values]
            database.executemany("INSERT INTO value VALUES (?, ?, ?, ?, ?)", rows)
            database.execute("COMMIT")
        except BaseException:
            self._ids.clear()  # what was given to new layouts is taken back
            if database.in_transaction:
                database.execute("ROLLBACK")
            raise

    def forget(self, robot: str) -> None:
        """Remove all of a robot."""
        _forget(self._database, robot)
        self._ids.clear()
        self.ranges.pop(robot, None)

    def _id(self, layout: Layout) -> int:
        if (known := self._ids.get(layout)) is None:
            found = self._database.execute(
                "SELECT id FROM layout WHERE robot = ? AND joints = ? AND floating = ? AND urdf = ?", _row(layout)
            ).fetchone()
            if found is None:
                more = "INSERT INTO layout (robot, joints, floating, urdf, oldest, newest) VALUES (?, ?, ?, ?, ?, 0)"
                known = self._database.execute(more, (*_row(layout), 2**63 - 1)).lastrowid or 0
            else:
                known = int(found[0])
            self._ids[layout] = known
        return known

    def _write_frames(self, id: int, layout: Layout, frames: Sequence[bytes]) -> None:
        stamps = [wall_ns(each) for each in frames]
        rows = [(id, stamp, each) for stamp, each in zip(stamps, frames, strict=True)]
        self._database.executemany("INSERT OR REPLACE INTO frame VALUES (?, ?, ?)", rows)
        low, high = min(stamps), max(stamps)
        self._database.execute(
            "UPDATE layout SET oldest = min(oldest, ?), newest = max(newest, ?) WHERE id = ?", (low, high, id)
        )
        before = self.ranges.get(layout.robot, (low, high))
        self.ranges[layout.robot] = min(before[0], low), max(before[1], high)
        self._waiting[id] = self._waiting.get(id, 0) + len(rows)
        if self._waiting[id] >= _BLOCK:
            self._pack(id)

    def _pack(self, id: int) -> None:
        """Replace the frames of a layout by blocks of equally long ones."""
        frames = [data for (data,) in self._database.execute("SELECT data FROM frame WHERE layout = ?", (id,))]
        for first in range(0, len(frames), 2 * _BLOCK):
            some = frames[first : first + 2 * _BLOCK]
            row = (id, wall_ns(some[0]), wall_ns(some[-1]), len(some[0]), packed(some))
            self._database.execute("INSERT INTO block VALUES (?, ?, ?, ?, ?)", row)
        self._database.execute("DELETE FROM frame WHERE layout = ?", (id,))
        self._waiting[id] = 0

    def finish(self) -> None:
        """Pack what is left, and make it a single file unless somebody reads it (``finish_left`` does that later)."""
        database = self._database
        database.execute("BEGIN")
        for (id,) in database.execute("SELECT DISTINCT layout FROM frame").fetchall():
            self._pack(id)
        database.execute(f"PRAGMA user_version = {_FINISHED}")
        database.execute("COMMIT")
        self.is_single = _to_single_file(database)

    def close(self) -> None:
        self._database.close()


def finish_left(path: Path) -> None:
    """Finish a segment that a killed process has left, unless another process has it open.

    Raises DamagedSegmentError, UnreadableSegmentError.
    """
    try:
        _finish_left(path)
    except sqlite3.Error as error:
        raise _error_of(error) from error


def _finish_left(path: Path) -> None:
    with closing(sqlite3.connect(path, timeout=0.0, isolation_level=None)) as database:
        _check(database)
        if not _to_single_file(database):
            raise UnreadableSegmentError("another process has it open")
        if database.execute("PRAGMA user_version").fetchone() != (_FINISHED,):
            database.execute(f"PRAGMA user_version = {_FINISHED}")


def forget_in(path: Path, robot: str) -> None:
    """Remove all of a robot from a finished segment; another one is its writer's.

    Raises DamagedSegmentError, UnreadableSegmentError.
    """
    try:
        with closing(sqlite3.connect(path, timeout=_BUSY_S, isolation_level=None)) as database:
            _check(database)
            if database.execute("PRAGMA user_version").fetchone() == (_FINISHED,):
                _forget(database, robot)
    except sqlite3.Error as error:
        raise _error_of(error) from error


def _forget(database: sqlite3.Connection, robot: str) -> None:
    database.execute("PRAGMA secure_delete = ON")
    database.execute("BEGIN IMMEDIATE")
    try:
        for table in ("frame", "block"):
            database.execute(f"DELETE FROM {table} WHERE layout IN (SELECT id FROM layout WHERE robot = ?)", (robot,))  # noqa: S608
        for table in ("layout", "value"):
            database.execute(f"DELETE FROM {table} WHERE robot = ?", (robot,))  # noqa: S608
        database.execute("DELETE FROM value WHERE robot = ? AND path = ?", (WORLD, PLACEMENTS + robot))
        database.execute("COMMIT")
    except BaseException:
        if database.in_transaction:
            database.execute("ROLLBACK")
        raise


def _to_single_file(database: sqlite3.Connection) -> bool:
    """Return False if another connection keeps the file as it is."""
    with suppress(sqlite3.OperationalError):
        return bool(database.execute("PRAGMA journal_mode = DELETE").fetchone() == ("delete",))
    return False


def _error_of(error: sqlite3.Error) -> DamagedSegmentError | UnreadableSegmentError:
    """Return what an error says about a file: that a table is missing is no passing trouble, unlike other ones."""
    code = getattr(error, "sqlite_errorcode", 0) & 0xFF
    passing = isinstance(error, sqlite3.OperationalError) and code != sqlite3.SQLITE_ERROR
    return (UnreadableSegmentError if passing else DamagedSegmentError)(str(error))


def _check(database: sqlite3.Connection) -> None:
    if database.execute("PRAGMA application_id").fetchone() != (APPLICATION_ID,):
        raise sqlite3.DatabaseError("it is no segment of a history")


class Reader:
    """A segment that is read, by one thread. Its methods raise DamagedSegmentError, UnreadableSegmentError."""

    def __init__(self, path: Path) -> None:
        try:
            self._database = sqlite3.connect(f"{path.absolute().as_uri()}?mode=ro", uri=True, timeout=_BUSY_S)
        except sqlite3.Error as error:
            raise _error_of(error) from error
        try:
            _check(self._database)
        except sqlite3.Error as error:
            self._database.close()
            raise _error_of(error) from error

    def close(self) -> None:
        self._database.close()

    def is_finished(self) -> bool:
        return self._rows("PRAGMA user_version") == [(_FINISHED,)]

    def ranges(self) -> dict[str, Range]:
        """Return the times of each robot's oldest and newest frame."""
        rows = self._rows("SELECT robot, min(oldest), max(newest) FROM layout GROUP BY robot")
        if not all(isinstance(low, int) and isinstance(high, int) for _, low, high in rows):
            raise DamagedSegmentError("a time of a layout is no number")
        return {str(robot): (low, high) for robot, low, high in rows}

    def frames(self, robot: str, begin_ns: int, end_ns: int, backward: bool) -> Iterator[tuple[int, Layout, bytes]]:
        """Yield the stamped frames of a robot from ``begin_ns`` on and before ``end_ns``, in the order of time or
        against it.
        """
        rows = self._rows("SELECT id, joints, floating, urdf FROM layout WHERE robot = ?", robot)
        streams = list[Iterator[tuple[int, Layout, bytes]]]()
        for id, joints, floating, urdf in rows:
            layout = _layout(robot, joints, floating, urdf)
            streams += [self._raw(id, layout, begin_ns, end_ns, backward)]
            streams += [self._packed(id, layout, begin_ns, end_ns, backward)]
        return merge(*streams, key=lambda each: each[0], reverse=backward)

    def _raw(self, id: int, of: Layout, begin: int, end: int, backward: bool) -> Iterator[tuple[int, Layout, bytes]]:
        order = "DESC" if backward else "ASC"
        query = f"SELECT stamp, data FROM frame WHERE layout = ? AND stamp >= ? AND stamp < ? ORDER BY stamp {order}"  # noqa: S608
        for stamp, data in self._each(query, id, begin, end):
            self._check_size(len(data) if isinstance(data, bytes) else 0, of)
            yield stamp, of, data

    def _packed(self, id: int, of: Layout, begin: int, end: int, backward: bool) -> Iterator[tuple[int, Layout, bytes]]:
        order = "DESC" if backward else "ASC"
        query = f"SELECT data, size FROM block WHERE layout = ? AND newest >= ? AND oldest < ? ORDER BY oldest {order}"  # noqa: S608
        for data, size in self._each(query, id, begin, end):
            self._check_size(size, of)
            found = _unpacked(data, size)
            for each in reversed(found) if backward else found:
                if begin <= wall_ns(each) < end:
                    yield wall_ns(each), of, each

    def _check_size(self, size: int, of: Layout) -> None:
        if size != frame_size(of):
            raise DamagedSegmentError(f"a frame of {len(of.joints)} joints has {size} bytes")

    def values(self, robot: str, begin_ns: int, end_ns: int, path: str = "") -> Iterator[Said]:
        """Yield what components said from ``begin_ns`` on and before ``end_ns``, the oldest first.

        ``path`` is that of the only property that is wanted; empty for all.
        """
        query = (
            f"{_VALUES} stamp FROM value WHERE robot = ? AND stamp >= ? AND stamp < ? AND kind <> ?"
            " AND ? IN ('', path) ORDER BY stamp"
        )
        yield from (_said(robot, row) for row in self._each(query, robot, begin_ns, end_ns, HELD, path))

    def last_values(self, robot: str, until_ns: int) -> list[Said]:
        """Return the last value of each property of components up to a time."""
        query = f"{_VALUES} max(stamp) FROM value WHERE robot = ? AND stamp <= ? AND kind <> 'event' GROUP BY path"
        return [_said(robot, row) for row in self._rows(query, robot, until_ns)]

    def _rows(self, query: str, *values: object) -> list[tuple]:  # type: ignore[type-arg]
        return list(self._each(query, *values))

    def _each(self, query: str, *values: object) -> Iterator[tuple]:  # type: ignore[type-arg]
        try:
            yield from self._database.execute(query, values)
        except sqlite3.Error as error:
            raise _error_of(error) from error
        except UnicodeDecodeError as error:
            raise DamagedSegmentError(str(error)) from error


def _said(robot: str, row: tuple[object, ...]) -> Said:
    path, kind, json, stamp_ns = row
    if isinstance(path, str) and isinstance(kind, str) and isinstance(json, str) and isinstance(stamp_ns, int):
        return Said(robot, path, kind, json, stamp_ns)
    raise DamagedSegmentError("a value is not as it was written")


def _row(layout: Layout) -> tuple[str, str, bool, bytes]:
    return layout.robot, json.dumps(layout.joints), layout.floating, zlib.compress(layout.urdf.encode(), 6)


def _layout(robot: str, joints: str, floating: int, urdf: bytes) -> Layout:
    try:
        return Layout(robot, _names(joints), bool(floating), _inflated(urdf, _MOST_URDF).decode())
    except (ValueError, TypeError, RecursionError, zlib.error) as error:
        raise DamagedSegmentError(str(error)) from error


def _names(text: str) -> tuple[str, ...]:
    found = json.loads(text)
    if not isinstance(found, list) or not all(isinstance(each, str) for each in found):
        raise ValueError("names of joints are strings")
    return tuple(found)


def _by_layout(frames: Iterable[tuple[Layout, bytes]]) -> dict[Layout, list[bytes]]:
    found: dict[Layout, list[bytes]] = {}
    for layout, frame in frames:
        found.setdefault(layout, []).append(frame)
    return found


def packed(frames: Sequence[bytes]) -> bytes:
    """Return frames of one length as a block: the first byte of each, the second of each …, compressed with zlib."""
    joined, size = b"".join(frames), len(frames[0])
    return zlib.compress(b"".join(joined[first::size] for first in range(size)), 1)


def _inflated(data: bytes, most: int) -> bytes:
    """Raise ValueError, TypeError, zlib.error."""
    stream = zlib.decompressobj()
    found = stream.decompress(data, most + 1)
    if len(found) > most or not stream.eof:
        raise ValueError(f"its content has more than {most} bytes, or no end")
    return found


def _unpacked(data: bytes, size: int) -> list[bytes]:
    try:
        columns = _inflated(data, 2 * _BLOCK * size)
        count, rest = divmod(len(columns), size)
        if rest or not count:
            raise ValueError(f"{len(columns)} bytes are no frames of {size}")
    except (ValueError, TypeError, ArithmeticError, zlib.error) as error:
        raise DamagedSegmentError(str(error)) from error
    return [columns[first::count] for first in range(count)]
