"""After the start of a gateway, event streams of robots that are not back yet stay open until they are."""

import contextlib
import signal
import time
from collections.abc import Iterator
from pathlib import Path

import httpx
import pytest
import zenoh

from authenticated_gateway import AuthenticatedGateway, run_authenticated
from connections import http_client
from fake_robots import FakeRobot, open_session
from linked_fleet_gateway.http.awaited_robots import AWAIT_S, MAX_WAITING, MAX_WAITING_OF_CLIENT, AwaitedRobots
from running import Process, eventually
from small_fleet import Place
from subscribers import EVENTS, events

pytestmark = pytest.mark.virtual

_PATH = "arm/elbow/rotation"


@pytest.fixture
def started(tmp_path: Path) -> Iterator[tuple[str, Process, zenoh.Session]]:
    place = Place(tmp_path)
    with place.gateway() as (gateway, browser), open_session(place.zenoh) as session:
        yield browser.root, gateway, session
        assert "Traceback" not in gateway.output, gateway.output


def _status(url: str, **fields: str) -> int:
    headers = {"accept": EVENTS, **{name.replace("_", "-"): value for name, value in fields.items()}}
    with http_client(timeout=5) as http, http.stream("GET", url, headers=headers) as response:
        return response.status_code


def test_a_stream_begins_when_its_robot_is_there(started: tuple[str, Process, zenoh.Session]) -> None:
    """Whoever asks six seconds before the agent is back gets the present state, and then each change."""
    root, _, session = started
    with events(root + _PATH) as stream:
        time.sleep(6)
        FakeRobot(session, "arm").appear().stand(0.25)
        eventually(lambda: stream.next().angle == 0.25, "the present position")
        assert stream.comments > 1


@pytest.mark.parametrize("path", ["arm/", "arm/elbow", "arm/jointState"])
def test_every_resource_of_a_robot_may_be_waited_for(started: tuple[str, Process, zenoh.Session], path: str) -> None:
    root, _, session = started
    with events(root + path) as stream:
        FakeRobot(session, "arm").appear().stand(0.25)
        assert len(stream.next().graph)


def test_a_stream_of_what_the_robot_does_not_have_ends(started: tuple[str, Process, zenoh.Session]) -> None:
    """The client returns, as it is not told to stay away, and gets 404."""
    root, _, session = started
    with events(root + "arm/wing/rotation") as stream:
        FakeRobot(session, "arm").appear().stand(0.25)
        assert stream.ended() and stream.last_event_id == ""
    assert _status(root + "arm/wing/rotation") == 404


def test_a_stream_waits_for_a_stated_time(started: tuple[str, Process, zenoh.Session]) -> None:
    root, _, _ = started
    with events(root + _PATH) as stream:
        time.sleep(AWAIT_S)
        assert stream.ended() and stream.last_event_id == ""
        assert stream.comments > AWAIT_S / 20
    assert _status(root + _PATH) == 404


@pytest.mark.parametrize(
    ("method", "path", "accept"),
    [
        ("GET", _PATH, "text/turtle"),
        ("GET", _PATH, f"{EVENTS};q=0.1, text/turtle"),
        ("HEAD", _PATH, EVENTS),
        ("GET", "world/nothing", EVENTS),
        ("GET", "nothing", EVENTS),
        ("GET", "~zz/elbow", EVENTS),
    ],
)
def test_anything_else_is_not_there(
    started: tuple[str, Process, zenoh.Session], method: str, path: str, accept: str
) -> None:
    assert httpx.request(method, started[0] + path, headers={"accept": accept}).status_code == 404


def test_a_waiting_stream_ends_with_its_gateway(tmp_path: Path) -> None:
    place = Place(tmp_path)
    with contextlib.ExitStack() as stack, place.gateway() as (gateway, browser):
        stream = stack.enter_context(events(browser.root + _PATH))
        gateway.send(signal.SIGTERM)
        assert stream.ended() and stream.last_event_id == ""


@pytest.fixture(scope="module")
def guarded(tmp_path_factory: pytest.TempPathFactory) -> Iterator[AuthenticatedGateway]:
    with run_authenticated(tmp_path_factory.mktemp("guarded"), robots=False) as here:
        here.add("reader", "read")
        here.add("lab", "read", "subscribe", robots=("lab-*",))
        here.known("lab")
        yield here


@pytest.mark.parametrize(
    ("name", "robot", "status"),
    [
        ("root", "lab-1", 200),
        ("lab", "lab-1", 200),
        ("lab", "hall-1", 404),
        ("reader", "lab-1", 404),
        (None, "lab-1", 401),
    ],
)
def test_only_who_may_subscribe_to_the_robot_waits(
    guarded: AuthenticatedGateway, name: str | None, robot: str, status: int
) -> None:
    fields = {} if name is None else {"authorization": f"Bearer {guarded.tokens[name]}"}
    assert _status(f"{guarded.root}{robot}/elbow/rotation", **fields) == status


def test_the_streams_that_wait_are_bounded() -> None:
    now_s = [0.0]
    robots = AwaitedRobots(10.0, lambda: now_s[0])
    with contextlib.ExitStack() as stack:
        for number in range(MAX_WAITING):
            client = f"client {number // MAX_WAITING_OF_CLIENT}"
            assert robots.has_room(client)
            stack.enter_context(robots.counted(client))
            assert robots.has_room(client) is ((number + 1) % MAX_WAITING_OF_CLIENT != 0)
        assert not robots.has_room("another")
    assert robots.has_room("client 0")
    assert robots.is_awaited("arm", None) and not robots.is_awaited("", None)
    now_s[0] = 10.0
    assert not robots.is_awaited("arm", None)
