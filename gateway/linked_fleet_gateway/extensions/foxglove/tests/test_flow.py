"""The flow of messages to clients of Foxglove: nothing for nobody, pictures, the world, and slow readers."""

import asyncio
import contextlib
import time
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import pytest
from websockets.exceptions import ConnectionClosed

from browser import Browser
from camera_robot import EYE, JPEG, CameraRobot
from fake_robots import FakeRobot, open_session
from floor_maps import FREE, UNKNOWN, WALL, pgm, upload, yaml
from foxglove_client import Client, connected
from linked_fleet_gateway.extensions.foxglove import messages
from linked_fleet_gateway.extensions.foxglove.protocol import SUBPROTOCOLS
from linked_fleet_rdf.vocabulary import PREFIXES
from linked_fleet_server.connection_limits import HIGH_WATER_BYTES, STALL_S
from small_fleet import Place, live
from virtual.client import WebSocket
from virtual.loop import current
from virtual.tcp import KERNEL_BYTES
from virtual.zenoh_gateway import GatewaySession

pytestmark = pytest.mark.virtual
EYE_TOPIC = "/seer/cameras/eye"
TURTLE = {"content-type": "text/turtle"}
PREFIXED = "".join(f"@prefix {prefix}: <{iri}> .\n" for prefix, iri in PREFIXES.items())
AT = "lf:position [ maths:x 10 ; maths:y 20 ; maths:z 30 ; vom:unit unit:M ]"
BOX = "a lf:Box ; lf:size [ maths:x 1 ; maths:y 2 ; maths:z 3 ; vom:unit unit:M ]"
BALL = "a lf:Sphere ; lf:radius [ vom:numericalValue 1 ; vom:unit unit:M ]"
ENCODERS = ("joint_states", "link_poses", "transforms", "pose", "picture", "log", "event", "scene")


@dataclass
class Hall:
    """A gateway with a simulated arm, and with a robot that has a camera."""

    place: Place
    browser: Browser
    seer: CameraRobot


@pytest.fixture(scope="module")
def hall(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Hall]:
    place = Place(tmp_path_factory.mktemp("state"))
    with place.gateway() as (_, browser), place.ur5(), open_session(place.zenoh) as session:
        seer = CameraRobot(FakeRobot(session, "seer")).appear(EYE)
        for name in ("ur5", "seer"):
            live(browser, name)
        yield Hall(place, browser, seer)


def thing(kind: str, geometry: str) -> str:
    return f'{PREFIXED}<> a {kind} ; dcterms:title "a thing" ; {AT} ; lf:geometry [ {geometry} ] .'


def added(hall: Hall, turtle: str) -> str:
    """Add an object to the world; its IRI."""
    answer = hall.browser.http.post(f"{hall.place.root}world/objects", content=turtle, headers=TURTLE)
    assert answer.status_code == 201, answer.text
    return answer.headers["location"]


@pytest.fixture
def encoded(monkeypatch: pytest.MonkeyPatch) -> Counter[str]:
    """Calls of encoders by their names."""
    calls = Counter[str]()
    for name in ENCODERS:
        whole = getattr(messages, name)

        def counted(*arguments: object, name: str = name, whole: object = whole) -> object:
            calls[name] += 1
            return whole(*arguments)  # type: ignore[operator]

        monkeypatch.setattr(messages, name, counted)
    return calls


def tasks() -> list[str]:
    """Tasks of the extension in the loop."""
    loop = current()
    assert loop is not None
    return [each.get_name() for each in asyncio.all_tasks(loop) if "Foxglove" in each.get_name()]


def heard(client: Client, seconds: float) -> list[tuple[int, int]]:
    """Messages that come within some time: the id of the subscription, and how long it was on the way (ns)."""
    found, end_s = [], time.monotonic() + seconds
    client.data.clear()
    while time.monotonic() < end_s:
        client.take()
        found += [(id, time.time_ns() - stamp_ns) for id, stamp_ns, _ in client.data]
        client.data.clear()
    return found


def test_nothing_is_done_while_nobody_is_connected(
    hall: Hall, encoded: Counter[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """No message is encoded, no task runs, and nothing more is declared at Zenoh than without clients."""
    declared, declare = Counter[str](), GatewaySession.declare

    def counted(self: GatewaySession, kind: Any, key: str, *more: Any) -> object:
        declared[kind] += 1
        return declare(self, kind, key, *more)

    monkeypatch.setattr(GatewaySession, "declare", counted)

    def quiet() -> None:
        hall.browser.http.post(f"{hall.place.root}ur5/actions/stop").raise_for_status()
        time.sleep(3)
        assert (dict(encoded), tasks(), hall.seer.asked) == ({}, [], [])

    quiet()
    with connected(hall.place.root) as client:
        client.until(lambda: "/ur5/tf" in client.channels)
        time.sleep(3)
        assert (dict(encoded), hall.seer.asked) == ({}, []), "nothing is computed for who has not subscribed"
        client.subscribe("/ur5/joint_states")
        heard(client, 1)
        assert encoded.keys() == {"joint_states"}
    encoded.clear()
    quiet()
    assert not declared


def test_pictures_of_a_camera_reach_all_who_want_them(hall: Hall) -> None:
    """The robot is asked at most 10 times a second, for both clients together, and no more when they are gone."""
    with connected(hall.place.root) as one, connected(hall.place.root, subprotocol=SUBPROTOCOLS[1]) as other:
        for client in (one, other):
            client.subscribe(EYE_TOPIC)
            picture = client.message(0, EYE_TOPIC)
            assert (picture.data, picture.format, picture.frame_id) == (JPEG, "jpeg", "seer/tip")
            assert picture.timestamp.seconds == 1_700_000_000
        before = len(hall.seer.asked)
        pictures = len(heard(one, 2))
        asked = len(hall.seer.asked) - before
        assert 10 <= pictures <= 21 and asked <= 21
        assert {each.format for each in hall.seer.asked} == {"jpeg"}
    time.sleep(1)
    before = len(hall.seer.asked)
    time.sleep(2)
    assert len(hall.seer.asked) == before


def test_objects_and_zones_are_shown_as_they_change(hall: Hall) -> None:
    with connected(hall.place.root) as client:
        client.subscribe("/world/objects")
        assert not client.message(0, "/world/objects").entities
        crate = added(hall, thing("lf:Obstacle", BOX))
        (entity,) = client.message(0, "/world/objects").entities
        assert crate.endswith(f"/world/objects/{entity.id}")
        assert (entity.frame_id, entity.cubes[0].size.z) == ("world", 3.0)
        zone = added(hall, thing("lf:KeepOutZone", BALL))
        found = {each.id: each for each in client.message(0, "/world/objects").entities}
        ball = found[zone.rpartition("/")[2]].spheres[0]
        assert len(found) == 2 and (ball.pose.position.y, ball.color.a) == (20.0, pytest.approx(0.3))
        for each in (crate, zone):
            assert hall.browser.http.delete(each).status_code == 204
        client.until(lambda: not client.message(0, "/world/objects").entities)


def test_the_map_of_the_floor_is_shown_as_it_changes(hall: Hall) -> None:
    address = f"{hall.place.root}world/map"
    with connected(hall.place.root) as client:
        client.subscribe("/world/map")
        assert client.message(0, "/world/map").column_count == 1
        image = pgm(((WALL, FREE, UNKNOWN), (WALL, FREE, FREE)))
        assert upload(hall.browser.http, address, image, yaml(0.5, (1.0, -2.0, 0.0))).status_code == 204
        grid = client.message(0, "/world/map")
        assert (grid.frame_id, grid.column_count, len(grid.data)) == ("world", 3, 6 * grid.cell_stride)
        assert (grid.pose.position.x, grid.cell_size.x) == (1.0, 0.5)
        assert hall.browser.http.delete(address).status_code == 204
        assert client.message(0, "/world/map").column_count == 1


def test_a_robot_that_is_placed_moves_into_the_world(hall: Hall) -> None:
    placement = f"{hall.place.root}seer/placement"
    with connected(hall.place.root) as client:
        client.subscribe("/seer/tf", "/seer/pose")
        assert client.message(1, "/seer/pose").frame_id == "seer/world"
        answer = hall.browser.http.put(placement, content=f"{PREFIXED}<> {AT} .", headers=TURTLE)
        assert answer.status_code == 204, answer.text
        client.until(lambda: client.message(1, "/seer/pose").frame_id == "world")
        client.data.clear()
        found = {each.child_frame_id: each for each in client.message(0, "/seer/tf").transforms}
        assert found["seer/base"].parent_frame_id == "world" and found["seer/base"].translation.y == 20.0
        assert hall.browser.http.delete(placement).status_code == 204


def test_each_client_gets_the_last_frame_of_a_robot_that_has_left(hall: Hall) -> None:
    """Whoever saw it before, and also a client that returns."""
    with open_session(hall.place.zenoh) as session:
        FakeRobot(session, "gone").appear().stand(0.25)
        live(hall.browser, "gone")
    topics = ("/gone/joint_states", "/gone/tf")

    def shown(client: Client) -> None:
        client.data.clear()
        client.subscribe(*topics)
        assert client.message(0, topics[0]).joints[0].position == 0.25
        assert client.message(1, topics[1]).transforms

    with connected(hall.place.root) as one:
        shown(one)
        with connected(hall.place.root) as other:
            shown(other)
        one.send("unsubscribe", subscriptionIds=[0, 1])
        shown(one)


def test_a_slow_reader_misses_frames_and_holds_up_nobody(hall: Hall) -> None:
    """At most 64 KiB and a message wait for it in the gateway, and as much in the kernel. What it reads next is new;
    the other client gets all frames at once all the while."""
    loop = current()
    assert loop is not None
    url, topics = hall.place.root.replace("http", "ws", 1) + "foxglove", ("/ur5/joint_states", "/ur5/tf")
    slow = Client(WebSocket(loop, url, {}, SUBPROTOCOLS[0], receive_bytes=KERNEL_BYTES))
    with slow, connected(hall.place.root) as fast:
        slow.subscribe(*topics)
        fast.subscribe(*topics)
        fast.message(0, topics[0])
        found = heard(fast, 10)
        states = [late_ns for id, late_ns in found if id == 0]
        assert len(states) > 900 and max(states) < 20_000_000
        resumed_ns, waited, last_ns = time.time_ns(), 0, 0
        while last_ns < resumed_ns:
            slow.take()
            while slow.data:
                _, last_ns, content = slow.data.pop(0)
                waited += len(content) if last_ns < resumed_ns else 0
        assert 10_000 < waited < KERNEL_BYTES + HIGH_WATER_BYTES + 10_000
        assert len(heard(slow, 1)) > 90, "who reads again gets all frames again"


def test_a_stalled_client_is_disconnected_and_gets_the_state_when_it_reconnects(hall: Hall) -> None:
    loop = current()
    assert loop is not None
    url = hall.place.root.replace("http", "ws", 1) + "foxglove"
    dead = Client(WebSocket(loop, url, {}, SUBPROTOCOLS[0], receive_bytes=1024))
    dead.subscribe("/ur5/joint_states", "/ur5/log")
    time.sleep(3 * STALL_S)
    assert tasks() == []
    with contextlib.suppress(OSError), pytest.raises(ConnectionClosed):
        dead.until(lambda: False)
    with connected(hall.place.root) as again:
        again.subscribe("/ur5/log")
        assert again.message(0, "/ur5/log").message == "online"
