"""The history on disk: what is kept of what was heard, its bounds, and what survives kills, damage and a full disk."""

import math
import sqlite3
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

import pytest

from linked_fleet_agent.wire.codec import encode_state
from linked_fleet_agent.wire.messages import State
from linked_fleet_gateway.extensions.history.archive import Archive
from linked_fleet_gateway.extensions.history.segment import Layout, Said, Writer
from linked_fleet_gateway.extensions.history.shelf import HELD_NS
from linked_fleet_gateway.extensions.history.thinning import STILL_NS, Thinning, gap_after, is_gap
from linked_fleet_gateway.extensions.history.track import wall_ns

S = 1_000_000_000
HOUR = 3600 * S
BEGIN = 1_800_000_000 * S
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
        disk.archive.add_values([Said("r", "gripper/opening", "value", str(n), BEGIN + n * S)])
        disk.now_ns += HOUR
        disk.write()
    assert [each.json for each in disk.archive.shelf.values("r", BEGIN + S, BEGIN + 4 * S, 100)] == ["1", "2", "3"]
    assert disk.archive.shelf.values_at("r", BEGIN + 3 * S - 1)["gripper/opening"].json == "2"
    assert disk.archive.shelf.values_at("r", BEGIN - 1) == {}


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
