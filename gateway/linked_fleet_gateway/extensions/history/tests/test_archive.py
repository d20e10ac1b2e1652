"""The history on disk: what is kept of what was heard, its bounds, and what survives kills, damage and a full disk."""

import math
import sqlite3
import threading
import tracemalloc
import zlib
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

import pytest

from linked_fleet_agent.wire.codec import encode_state
from linked_fleet_agent.wire.messages import State
from linked_fleet_gateway.extensions.history import archive as archive_module
from linked_fleet_gateway.extensions.history import beyond, kept_values
from linked_fleet_gateway.extensions.history.archive import Archive
from linked_fleet_gateway.extensions.history.describe import Page
from linked_fleet_gateway.extensions.history.segment import Layout, Reader, Said, Writer
from linked_fleet_gateway.extensions.history.shelf import HELD_NS
from linked_fleet_gateway.extensions.history.span import Span
from linked_fleet_gateway.extensions.history.thinning import STILL_NS, Thinning, gap_after, is_gap
from linked_fleet_gateway.extensions.history.track import LATEST_NS, Excerpt, Joints, wall_ns
from linked_fleet_state.model import RobotModel

S = 1_000_000_000
HOUR = 3600 * S
BEGIN = 1_800_000_000 * S
OPENING = "gripper/opening"
URDF = """<robot name='r'><link name='a'/><link name='b'/>
<joint name='turn' type='continuous'><parent link='a'/><child link='b'/></joint></robot>"""


def frame(stamp_ns: int, value: float = 0.0) -> bytes:
    row = (value,)
    return encode_state(
        State(incarnation=1, sequence=1, monotonic_ns=1, wall_ns=stamp_ns, positions=row, velocities=row, efforts=row)
    )


def layout(robot: str = "r", urdf: str = URDF) -> Layout:
    return Layout(robot, ("turn",), False, urdf)


class Disk:
    """An archive whose time is set, and whose thread is this one."""

    def __init__(self, folder: Path, keep_s: float = 86_400.0, most_bytes: int = 10**9, rate_hz: float = 2.0) -> None:
        self.now_ns = BEGIN
        self.full = False
        self.said = list[Exception | None]()
        self.archive = Archive(
            folder, keep_s, most_bytes, rate_hz, self.said.append, lambda: self.now_ns, lambda path: Full(path, self)
        )
        self.archive.look_around()

    def hear(self, *frames: bytes, robot: str = "r", urdf: str = URDF) -> None:
        """Write a batch at the time of its last frame."""
        if robot not in self.archive._layouts or self.archive._layouts[robot].urdf != urdf:
            self.archive.begin(layout(robot, urdf))
        for each in frames:
            self.archive.add(robot, each)
        self.now_ns = max([self.now_ns, *map(wall_ns, frames)])
        self.write()

    def write(self) -> None:
        self.archive.write(self.archive._take(), self.now_ns / S)

    def move(self, begin_ns: int, seconds: float, robot: str = "r", batch: int = 10) -> list[bytes]:
        """Hear a robot that moves, ten times a second, in batches of so many frames."""
        found = [frame(begin_ns + n * S // 10, math.sin(n / 7)) for n in range(int(seconds * 10))]
        for first in range(0, len(found), batch):
            self.hear(*found[first : first + batch], robot=robot)
        return found

    def say(self, json: str, stamp_ns: int, path: str = OPENING, robot: str = "r") -> None:
        """Let a component say something, which the next batch has."""
        self.now_ns = max(self.now_ns, stamp_ns)
        self.archive.add_values([Said(robot, path, "value", json, stamp_ns)])

    def said_between(self, begin_ns: int, end_ns: int, robot: str = "r") -> list[str]:
        return [each.json for each in self.archive.shelf.values(robot, begin_ns, end_ns, 10**6, 10**9)[0]]

    def frames(self, begin_ns: int | None = None, end_ns: int | None = None, robot: str = "r") -> tuple[bytes, ...]:
        return self.archive.shelf.read(robot, begin_ns, end_ns, 10**6).frames


class Full(Writer):
    """A segment on a disk that may be full."""

    def __init__(self, path: Path, disk: Disk) -> None:
        self._disk = disk
        if disk.full:
            raise sqlite3.OperationalError("unable to open database file")
        super().__init__(path)

    def write(self, *args, **more) -> None:  # type: ignore[no-untyped-def]
        if self._disk.full:
            raise sqlite3.OperationalError("database or disk is full")
        super().write(*args, **more)


@pytest.fixture
def disk(tmp_path: Path) -> Iterator[Disk]:
    made = Disk(tmp_path / "history")
    yield made
    made.archive.close()


# -- what is kept -----------------------------------------------------------------------------------------------------


def test_of_a_robot_that_moves_some_frames_a_second_are_kept_as_they_were(disk: Disk) -> None:
    heard = disk.move(BEGIN, 60)
    kept = disk.frames()
    assert set(kept) < set(heard) and len(kept) == 120
    assert kept[0] == heard[0]


def test_of_a_robot_that_rests_a_frame_in_ten_seconds_is_kept_and_the_last_before_it_moves() -> None:
    thinning = Thinning(2.0)
    kept = [each for n in range(250) for each in thinning.take(frame(BEGIN + n * S // 10))]
    assert [(wall_ns(each) - BEGIN) // S for each in kept] == [0, 10, 20]
    assert [wall_ns(each) - BEGIN for each in thinning.take(frame(BEGIN + 25 * S, 1.0))] == [249 * S // 10, 25 * S]


def test_where_a_robot_was_not_heard_the_record_has_a_gap(disk: Disk) -> None:
    first, second = disk.move(BEGIN, 5), disk.move(BEGIN + 65 * S, 5)
    kept = disk.frames()
    (gap,) = [each for each in kept if is_gap(each)]
    assert gap == gap_after(first[-1]) and first[-1] in kept
    assert disk.archive.shelf.at("r", wall_ns(first[-1])).frames == (first[-1],)
    assert disk.archive.shelf.at("r", wall_ns(first[-1]) + S // 10).frames == ()
    assert disk.archive.shelf.at("r", wall_ns(second[0]) - 1).frames == ()
    assert disk.archive.shelf.at("r", wall_ns(second[0])).frames == (second[0],)


def test_a_robot_that_falls_silent_gets_its_gap_without_another_frame(disk: Disk) -> None:
    heard = disk.move(BEGIN, 3)
    disk.now_ns += 3 * S
    disk.write()
    assert disk.frames()[-2:] == (heard[-1], gap_after(heard[-1]))


def test_each_frame_that_is_kept_holds_until_the_next(disk: Disk) -> None:
    for n in range(40):
        disk.hear(frame(BEGIN + n * S, 0.25))
    kept = disk.frames()
    assert max(wall_ns(b) - wall_ns(a) for a, b in pairwise(kept)) <= STILL_NS < HELD_NS
    assert disk.archive.shelf.at("r", BEGIN + 9 * S).frames == kept[:1]


def test_spans_have_their_beginning_and_not_their_end_and_say_what_does_not_fit(disk: Disk) -> None:
    disk.move(BEGIN, 120)
    kept = disk.frames()
    stamps = [wall_ns(each) for each in kept]
    assert disk.frames(stamps[3], stamps[9]) == kept[3:9] == disk.frames(stamps[2] + 1, stamps[8] + 1)
    first, last = disk.archive.shelf.read("r", stamps[1], None, 50), disk.archive.shelf.read("r", None, stamps[200], 50)
    assert (first.frames, first.after, first.before) == (kept[1:51], stamps[51], None)
    assert (last.frames, last.after, last.before) == (kept[150:200], None, stamps[149])
    assert disk.archive.shelf.read("nobody", 0, None, 10).frames == ()


def test_other_joints_are_another_page(disk: Disk) -> None:
    disk.move(BEGIN, 3)
    other = URDF.replace("name='r'", "name='s'")
    for n in range(3):
        disk.hear(frame(BEGIN + (3 + n) * S, n), urdf=other)
    first = disk.archive.shelf.read("r", 0, None, 10**6)
    assert first.layout == layout() and first.after is not None
    second = disk.archive.shelf.read("r", BEGIN + 3 * S, None, 10**6)
    assert second.layout == layout(urdf=other) and len(second.frames) == 3


def test_values_of_components_are_those_of_their_time(disk: Disk) -> None:
    for n in range(5):
        disk.say(str(n), BEGIN + n * HOUR)
        disk.move(BEGIN + n * HOUR, 3)
    assert disk.said_between(BEGIN + HOUR, BEGIN + 4 * HOUR) == ["1", "2", "3"]
    assert disk.archive.shelf.values_at("r", BEGIN + 3 * HOUR + S)[OPENING].json == "3"
    assert disk.archive.shelf.values_at("r", BEGIN - 1) == {}


def test_what_held_at_a_time_is_in_the_segment_of_that_time(disk: Disk, monkeypatch: pytest.MonkeyPatch) -> None:
    disk.say("0.5", BEGIN)
    for hour in range(6):
        disk.move(BEGIN + hour * HOUR, 3)
    read = list[Path]()
    usual = Reader.last_values
    monkeypatch.setattr(Reader, "last_values", lambda self, *of: read.append(self) or usual(self, *of))
    for hour in (1, 5):
        (held,) = disk.archive.shelf.values_at("r", BEGIN + hour * HOUR + S).values()
        assert (held.json, held.stamp_ns) == ("0.5", BEGIN)
    assert len(read) <= 4 and disk.archive.shelf.count == 6, "each one, and the next that has the gap after it"
    assert disk.said_between(0, LATEST_NS) == ["0.5"], "once"


@pytest.mark.parametrize(
    ("most", "sizes"), [(1, [2, 2, 1]), (2, [2, 2, 1]), (3, [4, 1]), (4, [4, 1]), (5, [5]), (9, [5])]
)
def test_pages_keep_what_was_said_at_one_time_together(tmp_path: Path, most: int, sizes: list[int]) -> None:
    """Also if several gateways that share the folder have written it."""
    gateways = Disk(tmp_path), Disk(tmp_path)
    for disk in gateways:
        for n, at in enumerate((1, 1, 2, 2, 3)):
            disk.say("1", BEGIN + at * S, f"c/{n}")
        disk.write()
    gateways[0].archive.shelf.look()
    begin: int | None = 0
    found = list[int]()
    while begin is not None:
        some, begin = gateways[0].archive.shelf.values("r", begin, LATEST_NS, most)
        found.append(len(some))
    assert found == sizes


def test_pages_of_values_have_an_end_by_bytes_too(disk: Disk) -> None:
    for n in range(10):
        disk.say(f'"{n:0100}"', BEGIN + n * S)
    disk.write()
    some, after = disk.archive.shelf.values("r", 0, LATEST_NS, 1000, 250)
    assert len(some) == 3 and after == BEGIN + 3 * S


def test_pages_of_frames_have_an_end_by_bytes_too(disk: Disk) -> None:
    disk.move(BEGIN, 30)
    kept, size = disk.frames(), len(frame(1))
    found = disk.archive.shelf.read("r", 0, None, 10**6, 5 * size)
    assert found.frames == kept[:5] and found.after == wall_ns(kept[5])
    found = disk.archive.shelf.read("r", None, None, 10**6, 5 * size + 1)
    assert found.frames == kept[-5:] and found.before == wall_ns(kept[-6])
    assert len(disk.archive.shelf.read("r", 0, None, 10, 1).frames) == 1


# -- bounds -----------------------------------------------------------------------------------------------------------


def test_hours_that_are_too_old_are_removed(tmp_path: Path) -> None:
    disk = Disk(tmp_path, keep_s=3 * 3600)
    for hour in range(8):
        disk.move(BEGIN + hour * HOUR, 20)
    disk.now_ns += S
    disk.write()
    kept = disk.frames()
    assert 3 * HOUR <= wall_ns(kept[-1]) - wall_ns(kept[0]) <= 5 * HOUR
    assert disk.archive.shelf.extent("r") == (wall_ns(kept[0]), wall_ns(kept[-1]))
    assert len(list(tmp_path.glob("*.sqlite"))) == disk.archive.shelf.count <= 5


def test_all_segments_take_no_more_than_they_may(tmp_path: Path) -> None:
    most = 1_500_000
    disk = Disk(tmp_path, most_bytes=most)
    for minute in range(40):
        for robot in range(5):
            disk.move(BEGIN + minute * 60 * S, 60, robot=f"r{robot}", batch=600)
    size = sum(each.stat().st_size for each in tmp_path.iterdir())
    assert most / 2 < size < most * 1.2
    assert disk.archive.shelf.count > 8
    kept = disk.frames(robot="r3")
    assert wall_ns(kept[0]) > BEGIN + 300 * S and wall_ns(kept[-1]) > BEGIN + 2398 * S


def test_foreign_files_in_the_folder_stay(tmp_path: Path) -> None:
    foreign = tmp_path / "mine.sqlite"
    foreign.write_bytes(b"something")
    disk = Disk(tmp_path, keep_s=1.0)
    disk.move(BEGIN, 3)
    disk.now_ns += 5 * HOUR
    disk.write()
    assert foreign.read_bytes() == b"something" and disk.archive.shelf.damaged == []


# -- kills, damage, a full disk ---------------------------------------------------------------------------------------


def test_a_killed_gateway_loses_what_was_not_written_alone_and_the_next_one_marks_the_gap(tmp_path: Path) -> None:
    killed = Disk(tmp_path)
    heard = killed.move(BEGIN, 30)
    kept = killed.frames()
    killed.archive.add("r", frame(BEGIN + 31 * S))
    after = Disk(tmp_path)  # the first one wrote nothing more
    assert after.frames() == kept and after.archive.shelf.damaged == []
    again = after.move(BEGIN + 40 * S, 5)
    assert [wall_ns(each) for each in after.frames() if is_gap(each)] == [wall_ns(kept[-1]) + 1]
    assert after.archive.shelf.at("r", BEGIN + 35 * S).frames == ()
    assert after.archive.shelf.at("r", BEGIN + 40 * S).frames == (again[0],)
    assert heard[0] == after.frames()[0]


def test_a_gateway_that_ends_leaves_single_files_and_says_until_when_it_heard(tmp_path: Path) -> None:
    disk = Disk(tmp_path)
    heard = disk.move(BEGIN, 30)
    disk.archive.close()
    assert [each.suffix for each in tmp_path.iterdir()] == [".sqlite"]
    assert Disk(tmp_path).frames()[-2:] == (heard[-1], gap_after(heard[-1]))


@pytest.mark.parametrize("damage", ["cut", "header", "middle", "empty"])
def test_a_damaged_segment_is_skipped_and_said(tmp_path: Path, damage: str) -> None:
    disk = Disk(tmp_path)
    disk.move(BEGIN, 300)
    first = max(tmp_path.glob("*.sqlite"))
    for hour in (1, 2):
        disk.move(BEGIN + hour * HOUR, 30)
    disk.archive.close()
    content = bytearray(first.read_bytes())
    if damage == "header":
        content[:100] = bytes(100)
    if damage == "middle":
        content[4096:] = b"\xa5" * (len(content) - 4096)
    first.write_bytes({"cut": content[: len(content) // 2], "empty": b""}.get(damage, content))
    again = Disk(tmp_path)
    assert wall_ns(again.frames(BEGIN + HOUR)[0]) == BEGIN + HOUR
    again.frames()
    (said,) = again.archive.shelf.damaged
    assert first.name in said
    assert wall_ns(again.frames()[0]) > BEGIN + 299 * S
    later = again.move(BEGIN + 3 * HOUR, 5)
    assert later[0] in again.frames()


def test_a_full_disk_is_said_and_what_follows_is_written_again(disk: Disk) -> None:
    before = disk.move(BEGIN, 10)
    disk.full = True
    disk.move(BEGIN + 10 * S, 10)
    assert "disk is full" in disk.archive.failure and disk.archive.lost > 10
    assert [str(each) for each in disk.said] == ["database or disk is full"], "once"
    disk.full = False
    disk.move(BEGIN + 20 * S, 10)
    assert disk.archive.failure == "" and disk.said[-1] is None
    kept = disk.frames()
    assert len([each for each in kept if is_gap(each)]) == 1
    assert wall_ns(kept[-1]) > BEGIN + 29 * S and disk.archive.shelf.at("r", BEGIN + 15 * S).frames == ()
    assert before[0] == kept[0] and disk.archive.shelf.count == 1


def test_a_folder_that_cannot_be_written_is_said_and_costs_nothing_else(tmp_path: Path) -> None:
    (tmp_path / "history").write_text("a file where the folder should be")
    disk = Disk(tmp_path / "history")
    disk.move(BEGIN, 5)
    assert disk.archive.failure and disk.frames() == ()


def test_gateways_may_share_a_folder_and_each_answers_from_what_all_have_written(tmp_path: Path) -> None:
    one, other = Disk(tmp_path), Disk(tmp_path)
    heard = one.move(BEGIN, 30)
    other.move(BEGIN, 30)
    other.move(BEGIN, 30, robot="s")
    for disk in (one, other):
        disk.now_ns += 61 * S
        disk.write()
    assert one.frames()[0] == heard[0] and len(one.frames()) == len({*map(wall_ns, one.frames())})
    assert one.frames(robot="s") == other.frames(robot="s") != ()


def test_a_gateway_that_begins_leaves_the_segment_of_another_as_it_is(tmp_path: Path) -> None:
    one = Disk(tmp_path)
    one.move(BEGIN, 10)
    other = Disk(tmp_path)
    before = other.frames()
    assert before == one.frames() != ()
    one.move(BEGIN + 10 * S, 10)
    assert len(other.frames()) > len(before) and other.archive.findings == one.archive.findings == []


@pytest.mark.parametrize("span", [Span(begin_ns=0), Span(end_ns=BEGIN + HOUR)], ids=["forward", "backward"])
@pytest.mark.parametrize("in_memory", [0, 3])
def test_pages_of_disk_and_memory_have_an_end_by_bytes(
    disk: Disk, span: Span, in_memory: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    disk.move(BEGIN, 3)
    disk.archive.close()
    model, size = RobotModel.for_urdf(URDF), len(frame(1))
    later = tuple(frame(BEGIN + (4 + n) * S) for n in range(in_memory))
    excerpt = Excerpt(Joints(model, ("turn",), False), later) if later else None
    page = Page(span, excerpt, (wall_ns(later[0]), wall_ns(later[-1])) if later else None)
    monkeypatch.setattr(beyond, "MOST_BYTES", 5 * size)
    read = beyond.beyond(disk.archive, "r", page, 10**6)
    assert read is not None
    found = read().excerpt
    assert found is not None and sum(map(len, found.frames)) == 5 * size
    assert (found.after if span.forward else found.before) is not None


# -- what one robot, one batch or one reader does costs no other ------------------------------------------------------


def test_a_frame_that_cannot_be_written_costs_no_other_robot(disk: Disk, caplog: pytest.LogCaptureFixture) -> None:
    disk.hear(frame(BEGIN - S))
    disk.archive.begin(layout("broken"))
    for n in range(5):
        disk.archive.add("broken", b"short")
        disk.hear(frame(BEGIN + n * S, n))
    assert len(disk.frames()) == 6 and disk.archive.lost == 5 and disk.archive.failure == ""
    assert len([each for each in caplog.messages if "a frame is lost" in each]) == 1, "once"


@pytest.mark.parametrize("stamp_ns", [-1, BEGIN + 61 * S, 2**63 - 1, 2**63, 2**64])
def test_values_with_times_that_cannot_be_cost_no_other(disk: Disk, stamp_ns: int) -> None:
    disk.archive.add_values([Said("s", OPENING, "event", "1", stamp_ns)])
    disk.say("0.5", BEGIN)
    disk.write()
    assert disk.said_between(0, LATEST_NS) == ["0.5"] and disk.archive.lost == 1 and disk.archive.failure == ""


def test_whatever_a_batch_has_in_it_is_counted_and_said_and_the_next_one_is_written(disk: Disk) -> None:
    disk.say("\ud800", BEGIN)
    disk.hear(frame(BEGIN))
    assert disk.archive.lost == 2 and "UnicodeEncodeError" in disk.archive.failure
    disk.move(BEGIN + S, 3)
    assert disk.frames() and disk.archive.failure == ""


def test_a_talkative_component_has_a_bounded_part_of_a_segment_and_is_unknown_then(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(kept_values, "SHARE", 10**9 / 20_000)
    disk = Disk(tmp_path)
    for n in range(200):
        disk.say(f'"{n:0100}"', BEGIN + n * S, "talker/word")
        disk.say(str(n), BEGIN + n * S, robot="s")
        disk.move(BEGIN + n * S, 1)
    said = disk.said_between(0, LATEST_NS)
    assert sum(map(len, said)) < 20_000 and said[-1] == "null" and said.count("null") == 1
    assert disk.archive.shelf.values_at("r", BEGIN + 199 * S)["talker/word"].json == "null"
    assert len(disk.said_between(0, LATEST_NS, "s")) == 200, "it has its own part"
    assert disk.archive.lost > 80
    assert len([each for each in caplog.messages if "history of robot r" in each]) == 1, "said once"
    disk.move(BEGIN + HOUR, 3)
    held = disk.archive.shelf.values_at("r", BEGIN + HOUR + S)["talker/word"].json
    assert held == f'"{199:0100}"', "the next segment has room again"


def test_values_that_wait_are_bounded_by_bytes(disk: Disk, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(archive_module, "_MOST_PENDING_BYTES", 1000)
    for n in range(20):
        disk.say(f'"{n:0100}"', BEGIN + n)
    disk.write()
    assert disk.archive.lost == 15
    disk.say("1", BEGIN + S)
    disk.write()
    assert disk.said_between(0, LATEST_NS)[-1] == "1"


def test_a_segment_that_somebody_reads_is_finished_and_a_single_file_later(disk: Disk, tmp_path: Path) -> None:
    disk.move(BEGIN, 10)
    (path,) = (tmp_path / "history").glob("*.sqlite")
    reading = sqlite3.connect(path)
    rows = reading.execute("SELECT * FROM layout")
    assert rows.fetchone()
    after = disk.move(BEGIN + HOUR, 3)
    assert after[0] in disk.frames() and disk.archive.lost == 0 and disk.said == [] and disk.archive.failure == ""
    rows.close()
    reading.close()
    disk.now_ns += 61 * S
    disk.write()
    assert path.read_bytes()[18:20] == b"\1\1", "no write-ahead log"
    assert disk.frames()[0] == frame(BEGIN, 0.0)


def test_a_gateway_that_ends_while_a_batch_is_written_loses_nothing(tmp_path: Path) -> None:
    disk = Disk(tmp_path)
    disk.hear(frame(BEGIN))
    late = archive_module._Batch([("r", layout(), frame(BEGIN + S, 1.0))])
    writing, threads = threading.Event(), list[threading.Thread]()
    usual = disk.archive._chosen

    def chosen(*of: object) -> object:
        if not writing.is_set():
            writing.set()
            closing = threading.Thread(target=disk.archive.close)
            closing.start()
            closing.join(0.05)
            assert closing.is_alive(), "it waits for the batch"
            threads.append(closing)
        return usual(*of)  # type: ignore[arg-type]

    disk.archive._chosen = chosen  # type: ignore[method-assign, assignment]
    disk.archive.write(late, BEGIN / S + 1)
    threads[0].join()
    disk.archive.write(archive_module._Batch([("r", layout(), frame(BEGIN + 5 * S, 2.0))]), BEGIN / S + 5)
    assert disk.archive._writer is None and [each.suffix for each in tmp_path.iterdir()] == [".sqlite"] * 2
    assert {BEGIN, BEGIN + S, BEGIN + 5 * S} <= set(map(wall_ns, disk.frames()))


def test_a_removed_robot_goes_from_all_files_and_may_come_again(disk: Disk, tmp_path: Path) -> None:
    for hour in range(3):
        for robot in ("r", "s"):
            disk.say(f'"words of {robot}"', BEGIN + hour * HOUR, robot=robot)
            disk.move(BEGIN + hour * HOUR, 3, robot)
    kept = disk.frames(robot="s")
    disk.archive.forget("r")
    disk.write()
    assert disk.frames() == () and disk.said_between(0, LATEST_NS) == [] and disk.archive.shelf.extent("r") is None
    assert disk.frames(robot="s") == kept and len(disk.said_between(0, LATEST_NS, "s")) == 3
    again = disk.move(BEGIN + 3 * HOUR, 3)
    assert disk.frames()[0] == again[0] and disk.archive.lost == 0
    disk.archive.close()
    assert not [each for each in (tmp_path / "history").iterdir() if b"words of r" in each.read_bytes()]
    assert Disk(tmp_path / "history").frames(robot="s")[: len(kept)] == kept


def test_a_removed_robot_goes_from_a_file_that_was_locked_later(disk: Disk, tmp_path: Path) -> None:
    disk.move(BEGIN, 3)
    disk.move(BEGIN + HOUR, 3, "s")
    path = min((tmp_path / "history").glob("*.sqlite"))
    locking = sqlite3.connect(path, isolation_level=None)
    locking.execute("BEGIN IMMEDIATE")
    disk.archive.forget("r")
    disk.write()
    assert disk.frames() and disk.archive.failure == ""
    locking.execute("ROLLBACK")
    locking.close()
    disk.write()
    assert disk.frames() == () and disk.archive._forgotten == {}


# -- passing troubles, and bad contents -------------------------------------------------------------------------------


def _error(code: int) -> sqlite3.OperationalError:
    error = sqlite3.OperationalError("trouble")
    error.sqlite_errorcode = code
    return error


@pytest.mark.parametrize(
    "code",
    [
        sqlite3.SQLITE_BUSY,
        sqlite3.SQLITE_CANTOPEN,
        sqlite3.SQLITE_IOERR,
        sqlite3.SQLITE_IOERR_READ,
        sqlite3.SQLITE_FULL,
    ],
)
def test_a_passing_trouble_is_said_and_is_no_damage(disk: Disk, monkeypatch: pytest.MonkeyPatch, code: int) -> None:
    disk.move(BEGIN, 10)
    kept, usual = disk.frames(), sqlite3.connect
    disk.now_ns += HOUR

    def fail(*of: object, **more: object) -> object:
        raise _error(code)

    monkeypatch.setattr(sqlite3, "connect", fail)
    assert disk.frames() == () and disk.archive.shelf.damaged == []
    assert "cannot be read at present" in disk.archive.findings[0]
    monkeypatch.setattr(sqlite3, "connect", usual)
    assert disk.frames() == kept and disk.archive.findings == []


@pytest.mark.parametrize(("age_s", "damaged"), [(0, 0), (59, 0), (61, 1)])
def test_a_file_that_has_just_begun_is_no_damage(disk: Disk, tmp_path: Path, age_s: int, damaged: int) -> None:
    disk.move(BEGIN, 3)
    disk.now_ns = BEGIN + HOUR
    path = tmp_path / "history" / f"{disk.now_ns - age_s * S:020}-0123abcd.sqlite"
    sqlite3.connect(path).close()
    path.touch()
    disk.archive.shelf.look()
    assert disk.frames() and len(disk.archive.shelf.damaged) == damaged


@pytest.mark.parametrize(
    "change",
    [
        "UPDATE block SET data = 5", "UPDATE block SET data = NULL WHERE 0; UPDATE block SET data = 'text'",
        "UPDATE layout SET joints = '5'", "UPDATE layout SET joints = '[[]]'", "UPDATE layout SET urdf = 'x'",
        "UPDATE layout SET oldest = 'x'", "UPDATE block SET size = NULL", "UPDATE value SET said = NULL",
        "UPDATE value SET stamp = 'x' WHERE 0; UPDATE value SET said = x'00'", "DROP TABLE value", "DROP TABLE layout",
    ],
)  # fmt: skip
def test_bad_contents_are_damage(tmp_path: Path, change: str) -> None:
    disk = Disk(tmp_path)
    disk.say("1", BEGIN)
    disk.move(BEGIN, 3)
    disk.archive.close()
    (path,) = tmp_path.glob("*.sqlite")
    with sqlite3.connect(path) as database:
        database.executescript(change)
    database.close()
    again = Disk(tmp_path)
    again.now_ns += 2 * HOUR
    again.frames()
    again.said_between(0, LATEST_NS)
    assert len(again.archive.shelf.damaged) == 1


@pytest.mark.parametrize("size", [10**5, 10**8])
def test_a_block_that_expands_without_bounds_is_damage(tmp_path: Path, size: int) -> None:
    disk = Disk(tmp_path)
    disk.move(BEGIN, 3)
    disk.archive.close()
    (path,) = tmp_path.glob("*.sqlite")
    with sqlite3.connect(path) as database:
        database.execute("UPDATE block SET data = ?", (zlib.compress(bytes(size)),))
    database.close()
    again = Disk(tmp_path)
    again.now_ns += HOUR
    tracemalloc.start()
    again.frames()
    most = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert len(again.archive.shelf.damaged) == 1 and most < 10**6


def test_readers_are_told_no_path_of_the_state_folder(tmp_path: Path) -> None:
    (tmp_path / "history").write_text("a file where the folder should be")
    disk = Disk(tmp_path / "history")
    disk.move(BEGIN, 3)
    told = [*disk.archive.findings, *map(str, disk.said), disk.archive.failure]
    assert len(told) == 3 and not [each for each in told if str(tmp_path) in each]


def test_extents_of_many_robots_are_there_without_a_look_at_each_file(
    disk: Disk, monkeypatch: pytest.MonkeyPatch
) -> None:
    for hour in range(3):
        disk.move(BEGIN + hour * HOUR, 3)
    monkeypatch.setattr(disk.archive.shelf, "_known", lambda: pytest.fail("it looks at the files"))
    assert disk.archive.shelf.extent("r") == (BEGIN, wall_ns(frame(BEGIN + 2 * HOUR + 25 * S // 10)))
    assert disk.archive.shelf.extent("s") is None
