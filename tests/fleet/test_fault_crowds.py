"""Crowds of clients that send slowly, at a real gateway with few connections: others are served."""

import contextlib
import socket
from pathlib import Path

import pytest

from running import eventually
from tests.fleet.test_fault_clients import narrow

pytestmark = [pytest.mark.processes, pytest.mark.test_all]
SOCKETS = 30


def _closed(connection: socket.socket) -> bool:
    """Return True if the gateway has closed the connection; earlier data is dropped."""
    try:
        while True:
            if not connection.recv(1000):
                return True
    except BlockingIOError:
        return False
    except ConnectionResetError:
        return True


def test_many_slow_requests_cost_no_other_client_a_connection(tmp_path: Path) -> None:
    """Ten times as many as permitted, all in the middle of a header block or a body."""
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
