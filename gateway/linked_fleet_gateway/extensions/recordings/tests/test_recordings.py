"""Recordings: when one begins, what it contains, and how many are kept."""

import asyncio
import csv
import errno
import io
import math
import time
import uuid
from collections.abc import Iterator
from pathlib import Path
from typing import Any, cast

import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rdflib import URIRef

from browser import DCTERMS, LDP, Browser
from linked_fleet_agent.wire.codec import encode_state
from linked_fleet_agent.wire.messages import State
from linked_fleet_gateway.api import Core, RequestView, Resource
from linked_fleet_gateway.app.application import create_live
from linked_fleet_gateway.app.settings import GatewaySettings
from linked_fleet_gateway.extensions.history.files import CSV, MCAP
from linked_fleet_gateway.extensions.history.recorder import History
from linked_fleet_gateway.extensions.history.track import Excerpt, Joints, joints_of
from linked_fleet_gateway.extensions.recordings import folder, recorder
from linked_fleet_gateway.extensions.recordings.occasion import outcome
from linked_fleet_gateway.extensions.recordings.recorder import MOST_OF_ROBOT, MOST_WAITING, Job, Recorder
from linked_fleet_gateway.extensions.recordings.resources import TERMS, recordings_branch
from linked_fleet_gateway.subscriptions.live import Live
from linked_fleet_state.invocation import FLEET, Invocation, InvocationState
from running import eventually
from small_fleet import Place
from small_fleet import live as live_page
from subscribers import events
from virtual.zenoh_network import ZenohNetwork

pytestmark = pytest.mark.virtual
RECORDINGS = URIRef(TERMS + "recordings")
ACCEPTED, FAILED, SUCCEEDED = InvocationState.ACCEPTED, InvocationState.FAILED, InvocationState.SUCCEEDED


def frame(number: int, wall_ns: int, position: float = 0.0) -> bytes:
    one = (position,)
    return encode_state(
        State(
            incarnation=1, sequence=number, monotonic_ns=number, wall_ns=wall_ns, positions=one, velocities=one,
            efforts=(math.nan,),
        )
    )  # fmt: skip


class Bench(Recorder):
    """A recorder of robots ``r0``, ``r1`` …, without a writer."""

    def __init__(self, bench: Any, live: Live, folder: Path, robots: int) -> None:
        history = History(live.fleet, 300.0, 10.0, 10**6)
        nothing = cast(Any, None)
        super().__init__(Core(live, nothing, nothing, None, "", "", "", (), folder), history, None, folder)
        live.fleet = bench.fleet
        for number in range(robots):
            robot = bench.robot({"pan": ("continuous", "")}, name=f"r{number}")
            history.sample(robot._latest)  # in a gateway, the sampling task does this

    def begin(self, state: InvocationState = ACCEPTED, robot: str = "r0", **said: Any) -> Invocation:
        now_ns = time.time_ns()
        one = Invocation(str(uuid.uuid4()), robot, "/a", {}, now_ns, now_ns, state=state)
        for name, value in said.items():
            setattr(one, name, value)
        self.record_outcome(one)
        return one

    @property
    def begun(self) -> list[str]:
        return [self.waiting.get_nowait().robot for _ in range(self.waiting.qsize())]


@pytest.fixture
def made(bench: Any, tmp_path: Path) -> Bench:
    live = create_live(GatewaySettings(), ZenohNetwork().gateway("g"))
    live.fleet = bench.fleet
    return Bench(bench, live, tmp_path, MOST_WAITING + 2)


def test_a_motion_that_fails_is_recorded_once_and_one_that_succeeds_is_not(made: Bench) -> None:
    good, bad = made.begin(), made.begin()
    assert made.begun == []
    good.state, bad.state = SUCCEEDED, FAILED
    for one in (good, bad, bad):
        made.record_outcome(one)
    assert made.begun == ["r0"]


def test_a_stop_is_recorded_when_it_begins_for_each_robot_that_it_stops(made: Bench) -> None:
    one = made.begin(robot=FLEET, stops=(), robots={"r0": "accepted", "r1": "accepted", "unknown": "accepted"})
    made.record_outcome(one)
    assert made.begun == ["r0", "r1"]


def test_stops_in_a_row_are_one_recording(made: Bench) -> None:
    for _ in range(5):
        made.begin(stops=())
    assert made.begun == ["r0"]
    time.sleep(recorder.PAUSE_S)
    made.begin(stops=())
    assert made.begun == ["r0"]


def test_invocations_loaded_at_the_start_are_recorded_only_when_they_fail_later(made: Bench) -> None:
    before_ns = time.time_ns() - 10**9
    made._begun_ns = time.time_ns()
    made.begin(FAILED, created_ns=before_ns)
    made.begin(stops=(), created_ns=before_ns, state=SUCCEEDED)
    open_one = made.begin(created_ns=before_ns)
    assert made.begun == []
    open_one.state = FAILED
    made.record_outcome(open_one)
    assert made.begun == ["r0"]


def test_recordings_that_wait_are_bounded(made: Bench) -> None:
    for number in range(MOST_WAITING + 2):
        made.begin(stops=(), robot=f"r{number}")
    assert len(made.begun) == MOST_WAITING


async def test_a_recording_that_cannot_be_written_leaves_no_file_and_costs_no_other(
    made: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The disk is full here."""
    for _ in range(MOST_OF_ROBOT):
        made.begin(stops=())
        made._last_s.clear()
        await made._write_next()
    place = made._folder / folder.folder_name("r0")
    before = sorted(place.iterdir())
    assert len(before) == MOST_OF_ROBOT
    usual = Path.write_bytes

    def full(path: Path, content: bytes) -> int:
        usual(path, content[: len(content) // 2])
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(Path, "write_bytes", full)
    made.begin(stops=())
    await made._write_next()
    assert sorted(place.iterdir()) == before
    assert sorted(each.path for each in made.of("r0").values()) == before


async def test_what_a_killed_gateway_had_begun_to_write_is_removed_at_the_next_start(made: Bench) -> None:
    made.begin(stops=())
    await made._write_next()
    place = made._folder / folder.folder_name("r0")
    (whole,) = place.iterdir()
    for name in ("r0", "r1"):
        begun = made._folder / folder.folder_name(name) / "00000000000000000001-of-a-crash.new"
        begun.parent.mkdir(exist_ok=True)
        begun.write_bytes(b"x")
    async with made.running():
        assert [path for path in made._folder.rglob("*") if path.is_file()] == [whole]
        assert [each.path for each in made.of("r0").values()] == [whole]


async def test_a_recording_that_another_gateway_of_the_folder_is_writing_stays(
    made: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    usual = Path.write_bytes

    def slow(path: Path, content: bytes) -> int:
        usual(path, content[: len(content) // 2])
        folder.remove_unfinished(made._folder)  # at the start of another gateway
        assert path.exists()
        return usual(path, content)

    monkeypatch.setattr(Path, "write_bytes", slow)
    made.begin(stops=())
    await made._write_next()
    (written,) = made.of("r0").values()
    assert "/rosout" in read(written.read())


async def test_gateways_of_one_folder_keep_one_recording_of_an_invocation(made: Bench) -> None:
    """Each of them records it, and they would not know each other's files before their next start."""
    one = made.begin(stops=())
    await made._write_next()
    other = Recorder(made._core, made._history, None, made._folder)
    await asyncio.sleep(1.0)
    other.record_outcome(one)
    await other._write_next()
    (file,) = [path for path in made._folder.rglob("*") if path.is_file()]
    assert made.of("r0") == other.of("r0")
    assert [(id, each.path) for id, each in made.of("r0").items()] == [(one.id, file)]


def read(content: bytes) -> dict[str, list[tuple[int, Any]]]:
    """Return ROS 2 messages with their times, by topic."""
    found: dict[str, list[tuple[int, Any]]] = {}
    reader = make_reader(io.BytesIO(content), decoder_factories=[DecoderFactory()])
    for _, channel, message, decoded in reader.iter_decoded_messages():
        found.setdefault(channel.topic, []).append((message.log_time, decoded))
    return found


def test_the_file_ends_with_the_outcome_of_the_invocation(bench: Any) -> None:
    joints = joints_of(bench.robot({"pan": ("continuous", "")}))
    assert isinstance(joints, Joints)
    unmeasured = frame(2, 6, math.nan)[:-8] + b"\0\0\0\0\0\0\xf0\x7f"
    frames = (frame(1, 5, 0.5), unmeasured, frame(3, 2**62))
    one = Invocation("id", "r", "/r/actions/rotate", {}, 1, 2, client="c", state=FAILED, reason="outside limits")
    content = Job("r", Excerpt(joints, frames), b"<robot/>", outcome(one), 7).content
    found = read(content)
    assert [(at, each.position) for at, each in found["/joint_states"]] == [(5, [0.5]), (2**62, [0.0])]
    ((at, said),) = found["/rosout"]
    assert (at, said.level, said.name) == (2**62, 40, "r")
    assert said.msg == "/r/actions/rotate: failed, outside limits"
    (about,) = make_reader(io.BytesIO(content)).iter_metadata()
    assert about.metadata == {
        "id": "id", "action": "/r/actions/rotate", "client": "c", "state": "failed", "reason": "outside limits",
        "says": "/r/actions/rotate: failed, outside limits",
    }  # fmt: skip


def test_a_robot_without_samples_has_a_file_with_the_invocation_alone(bench: Any) -> None:
    joints = joints_of(bench.robot({"pan": ("continuous", "")}))
    assert isinstance(joints, Joints)
    one = Invocation("id", "r", "/r/actions/stop", {}, 1, 2, stops=(), state=SUCCEEDED)
    ((at, said),) = read(Job("r", Excerpt(joints), b"", outcome(one), 7).content)["/rosout"]
    assert (at, said.level) == (7, 30)


async def test_files_of_a_recording_are_made_in_a_thread(made: Bench) -> None:
    made.begin(stops=())
    await made._write_next()
    ((id, _),) = made.of("r0").items()
    view = cast(RequestView, None)
    found = recordings_branch(made).resolve(view, made._core.robots["r0"], [id])
    assert isinstance(found, Resource)
    renditions = [found.rendition(each) for each in (CSV, MCAP)]
    assert all(each is not None and each.is_long and each() for each in renditions)


@pytest.fixture
def robot(tmp_path: Path) -> Iterator[Browser]:
    place = Place(tmp_path)
    with place.gateway() as (_, browser), place.ur5():
        live_page(browser, "ur5")
        yield browser


def test_a_recording_is_found_by_links_and_read_by_the_reader_of_mcap(robot: Browser, tmp_path: Path) -> None:
    page = robot.robot("ur5")
    assert not list(page.graph.objects(page.iri, RECORDINGS))
    time.sleep(5)
    assert robot.http.post(f"{robot.root}ur5/actions/stop").status_code == 204

    def members() -> list[str]:
        found = robot.robot("ur5")
        links = list(found.graph.objects(found.iri, RECORDINGS))
        container = robot.page(str(links[0])) if links else None
        return [] if container is None else [str(each) for each in container.graph.objects(container.iri, LDP.contains)]

    (member,) = eventually(members, "the recording")
    assert str(robot.page(member).one(DCTERMS.format)) == "application/vnd.mcap"
    answer = robot.http.get(member, headers={"accept": "application/vnd.mcap"})
    assert answer.headers["content-type"] == "application/vnd.mcap"
    name = member.rpartition("/")[2]
    disposition = answer.headers["content-disposition"]
    assert disposition.startswith("attachment; filename=") and disposition.endswith(f'{name}.mcap"')
    assert "content-disposition" not in robot.http.get(member, headers={"accept": "text/turtle"}).headers
    states = read(answer.content)["/joint_states"]
    assert len(states) > 30 and len(states[0][1].name) == 6
    rows = list(csv.DictReader(io.StringIO(robot.http.get(member, headers={"accept": "text/csv"}).text, newline="")))
    for (_, said), row in zip(states, rows, strict=True):
        assert [float(each) for each in row.values() if "T" not in each] == [
            *said.position,
            *said.velocity,
            *said.effort,
        ]
    assert len(list((tmp_path / "recordings").glob("*/*.mcap"))) == 1
    with events(member.rpartition("/")[0], "text/event-stream") as container:
        container.next()
        time.sleep(recorder.PAUSE_S)
        assert robot.http.post(f"{robot.root}ur5/actions/stop").status_code == 204
        told = container.next()
        assert len(list(told.graph.objects(told.iri, LDP.contains))) == 2
    place = Place(tmp_path)
    with place.gateway() as (_, again), place.ur5():
        live_page(again, "ur5")
        path = member.removeprefix(robot.root)
        assert again.http.get(again.root + path, headers={"accept": "application/vnd.mcap"}).content == answer.content
