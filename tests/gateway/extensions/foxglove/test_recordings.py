"""Recordings: when one begins, what is in it, and how many there are at most."""

import io
import math
import time
import uuid
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from mcap.reader import make_reader
from rdflib import URIRef

from browser import DCTERMS, LDP, Browser
from foxglove_messages import decoded
from linked_fleet_agent.wire.codec import encode_state
from linked_fleet_agent.wire.messages import State
from linked_fleet_gateway.app.application import new_live
from linked_fleet_gateway.app.settings import GatewaySettings
from linked_fleet_gateway.extensions.foxglove import recordings
from linked_fleet_gateway.extensions.foxglove.recordings import MOST_WAITING, TERMS, Job, Recordings, recording
from linked_fleet_gateway.extensions.foxglove.template import LATEST_NS
from linked_fleet_gateway.extensions.history.recorder import History
from linked_fleet_gateway.extensions.history.track import Excerpt, Joints, joints_of
from linked_fleet_gateway.fleet.invocation import FLEET, Invocation, InvocationState
from linked_fleet_gateway.subscriptions.live import Live
from running import eventually
from small_fleet import Place
from small_fleet import live as live_page
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


class Bench(Recordings):
    """Recordings of robots ``r0``, ``r1`` …, that nobody writes."""

    def __init__(self, bench: Any, live: Live, folder: Path, robots: int) -> None:
        history = History(live.fleet, 300.0, 10.0, 10**6)
        super().__init__(live, history, folder)
        live.fleet = bench.fleet
        for number in range(robots):
            robot = bench.robot({"pan": ("continuous", "")}, name=f"r{number}")
            history.sample(robot._latest)  # the sampling task of a gateway does this

    def begin(self, state: InvocationState = ACCEPTED, robot: str = "r0", **said: Any) -> Invocation:
        now_ns = time.time_ns()
        one = Invocation(str(uuid.uuid4()), robot, "/a", {}, now_ns, now_ns, state=state)
        for name, value in said.items():
            setattr(one, name, value)
        self.hear(one)
        return one

    @property
    def begun(self) -> list[str]:
        return [self.waiting.get_nowait().robot for _ in range(self.waiting.qsize())]


@pytest.fixture
def made(bench: Any, tmp_path: Path) -> Bench:
    live = new_live(GatewaySettings(), ZenohNetwork().gateway("g"))
    live.fleet = bench.fleet
    return Bench(bench, live, tmp_path, MOST_WAITING + 2)


def test_a_motion_that_fails_is_recorded_once_and_one_that_succeeds_is_not(made: Bench) -> None:
    good, bad = made.begin(), made.begin()
    assert made.begun == []
    good.state, bad.state = SUCCEEDED, FAILED
    for one in (good, bad, bad):
        made.hear(one)
    assert made.begun == ["r0"]


def test_a_stop_is_recorded_when_it_begins_for_each_robot_that_it_stops(made: Bench) -> None:
    one = made.begin(robot=FLEET, stops=(), robots={"r0": "accepted", "r1": "accepted", "unknown": "accepted"})
    made.hear(one)
    assert made.begun == ["r0", "r1"]


def test_stops_in_a_row_are_one_recording(made: Bench) -> None:
    for _ in range(5):
        made.begin(stops=())
    assert made.begun == ["r0"]
    time.sleep(recordings.PAUSE_S)
    made.begin(stops=())
    assert made.begun == ["r0"]


def test_what_redis_brings_at_the_start_begins_no_recording_but_what_is_open_may_still_fail(made: Bench) -> None:
    before_ns = time.time_ns() - 10**9
    made._begun_ns = time.time_ns()
    made.begin(FAILED, created_ns=before_ns)
    made.begin(stops=(), created_ns=before_ns, state=SUCCEEDED)
    open_one = made.begin(created_ns=before_ns)
    assert made.begun == []
    open_one.state = FAILED
    made.hear(open_one)
    assert made.begun == ["r0"]


def test_recordings_that_wait_are_bounded(made: Bench) -> None:
    for number in range(MOST_WAITING + 2):
        made.begin(stops=(), robot=f"r{number}")
    assert len(made.begun) == MOST_WAITING


def read(content: bytes) -> dict[str, list[Any]]:
    found: dict[str, list[Any]] = {}
    for schema, channel, message in make_reader(io.BytesIO(content)).iter_messages():
        assert schema is not None and channel.message_encoding == "protobuf"
        one = decoded(schema.name, schema.data, message.data)
        found.setdefault(channel.topic, []).append((message.log_time, one))
    return found


def test_frames_that_cannot_be_read_are_skipped_and_absurd_stamps_are_clamped(bench: Any) -> None:
    joints = joints_of(bench.robot({"pan": ("continuous", "")}))
    assert isinstance(joints, Joints)
    frames = (
        frame(1, 5, 0.5),
        b"",
        b"x" * 64,
        frame(2, 6, math.nan)[:-8] + b"\0\0\0\0\0\0\xf0\x7f",
        frame(3, 2**63 - 1),
    )
    one = Invocation("id", "r", "/r/actions/stop", {}, 1, 2, stops=(), state=SUCCEEDED)
    found = read(recording(Job("r", Excerpt(joints, frames), None, one, 2**63)))
    assert [(at, each.joints[0].position) for at, each in found["/r/joint_states"]] == [(5, 0.5), (LATEST_NS, 0.0)]
    assert len(found["/r/tf"]) == 2
    ((_, event),) = found["/r/invocations"]
    assert {each.key: each.value for each in event.metadata}["action"] == "/r/actions/stop"


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
    states = read(answer.content)["/ur5/joint_states"]
    assert len(states) > 30 and len(states[0][1].joints) == 6
    assert len(list((tmp_path / "recordings").glob("*/*.mcap"))) == 1
    place = Place(tmp_path)
    with place.gateway() as (_, again), place.ur5():
        live_page(again, "ur5")
        path = member.removeprefix(robot.root)
        assert again.http.get(again.root + path, headers={"accept": "application/vnd.mcap"}).content == answer.content
