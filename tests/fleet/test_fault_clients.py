"""Clients that cost too much, at a real gateway with narrow bounds: others are served, and robots are stopped."""

import contextlib
import socket
from collections.abc import Iterator
from pathlib import Path

import httpx
import pytest
from browser import LF, Browser
from commanding import PAN, begun, moving, of_joint, of_robot, post, problem, put, slowly
from running import Process, eventually, process
from small_fleet import Place, live

pytestmark = pytest.mark.fleet
SOCKETS = 30


@contextlib.contextmanager
def narrow(folder: Path, *flags: str) -> Iterator[tuple[Place, Process, Browser]]:
    place = Place(folder)
    with process(*place.command(), *flags) as gateway, contextlib.closing(Browser(place.root)) as browser:
        gateway.said("serving")
        yield place, gateway, browser
        assert "Traceback" not in gateway.output


def _closed(connection: socket.socket) -> bool:
    """Whether the gateway has closed it; what it said before is dropped."""
    try:
        while True:
            if not connection.recv(1000):
                return True
    except BlockingIOError:
        return False
    except ConnectionResetError:
        return True


def test_crowds_that_drip_cost_nobody_else_a_connection(tmp_path: Path) -> None:
    """Ten times as many as there may be, all in the middle of a header block or a body."""
    begun_with = (b"GET / HTTP/1.1\r\nHost: x\r\n", b"POST / HTTP/1.1\r\nHost: x\r\nContent-Length: 9\r\n\r\n")
    with narrow(tmp_path, "--sockets", str(SOCKETS)) as (place, _, browser), contextlib.ExitStack() as open_:
        crowd = []
        for number in range(10 * SOCKETS):
            each = open_.enter_context(socket.create_connection(("127.0.0.1", place.port)))
            each.sendall(begun_with[number % 2])
            each.setblocking(False)
            crowd.append(each)
            if number % SOCKETS == 0:
                assert browser.http.get(place.root, headers={"connection": "close"}).status_code == 200
        eventually(lambda: sum(_closed(each) for each in crowd) >= 9 * SOCKETS, "most of them closed")
        assert browser.page(browser.root).response.status_code == 200


def _served(answer: httpx.Response) -> httpx.Response | None:
    """It, unless it is one that the rate refuses, or one of a motion that is not over yet."""
    return answer if answer.status_code == 200 and "lf:running" not in answer.text else None


def test_who_asks_too_often_is_told_so_and_stops_robots_all_the_same(tmp_path: Path) -> None:
    with narrow(tmp_path, "--requests-per-client", "40") as (place, _, browser), place.ur5():
        live(browser, "ur5")
        stop = of_robot(browser, LF.StopRobot)
        motion = begun(put(browser, of_joint(browser, PAN), slowly(2.0)))
        moving(browser, PAN)
        for _ in range(3000):
            answer = browser.http.get(browser.root)
            if answer.status_code == 429:
                break
        assert problem(answer) == (429, "too-many-requests")
        assert int(answer.headers["retry-after"]) > 0
        for path in ("health/live", "metrics"):
            assert browser.http.get(browser.root + path).status_code == 200
        begun(post(browser, stop))
        answer = eventually(lambda: _served(browser.http.get(motion)), "the end of the motion")
        assert "lf:state lf:cancelled" in answer.text
