"""The reads of the compose check while a gateway is killed."""

import contextlib
import http.client
import importlib
import socket
import sys
import threading
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import pytest

OK = b"HTTP/1.1 200 OK\r\nContent-Length: 4\r\n\r\n"


@pytest.fixture
def reads(monkeypatch: pytest.MonkeyPatch) -> Iterator[ModuleType]:
    """Import the module, which is part of a program and no package."""
    monkeypatch.syspath_prepend(str(Path(__file__).parents[2] / "deploy" / "fleet_check"))
    yield importlib.import_module("reads")
    for name in ("reads", "front"):
        sys.modules.pop(name, None)


@contextlib.contextmanager
def server(*answers: bytes) -> Iterator[int]:
    """Run a server that sends one answer per connection, the last one repeatedly; yield its port."""
    with socket.create_server(("127.0.0.1", 0)) as listener:

        def serve() -> None:
            waiting = list(answers)
            with contextlib.suppress(OSError):  # the listener is closed
                while True:
                    connection, _ = listener.accept()
                    with connection:
                        connection.recv(4096)
                        connection.sendall(waiting.pop(0) if len(waiting) > 1 else waiting[0])

        thread = threading.Thread(target=serve)
        thread.start()
        try:
            yield listener.getsockname()[1]
        finally:
            listener.shutdown(socket.SHUT_RDWR)
            thread.join()


def outcomes(reads: ModuleType, *answers: bytes) -> list[str]:
    """Make one read per answer, like the check."""
    with server(*answers) as port:
        done = threading.Semaphore(0)

        def read() -> int:
            connection = http.client.HTTPConnection("127.0.0.1", port, timeout=10)
            try:
                connection.request("GET", "/")
                answer = connection.getresponse()
                sys.modules["front"]._body(answer)
                return answer.status
            finally:
                connection.close()
                done.release()

        user = reads.RepeatedReads(read)
        for _ in answers:
            done.acquire()
        return user.stop()[: len(answers)]


def test_truncated_responses_are_distinguished_from_failed_reads(reads: ModuleType) -> None:
    whole, broken = OK + b"body", OK + b"bo"
    bad = b"HTTP/1.1 502 Bad Gateway\r\nContent-Length: 0\r\n\r\n"
    first, second, third, fourth, last = outcomes(reads, whole, broken, bad, b"", whole)
    assert (first, second, third, last) == (reads.ANSWERED, reads.TRUNCATED, "502", reads.ANSWERED)
    assert fourth.startswith("RemoteDisconnected"), "an answer that has not begun is the front's to repeat"


def test_one_read_may_break_off_if_the_next_is_answered(reads: ModuleType) -> None:
    answered, broken = reads.ANSWERED, reads.TRUNCATED
    assert reads.describe_violation([answered] * 100) == ""
    assert reads.describe_violation([*[answered] * 60, broken, *[answered] * 39]) == ""


@pytest.mark.parametrize(
    ("ending", "words"),
    [
        (["502", "answered"], "1 of 4 reads failed, the first with 502"),
        (["broken off", "502", "answered"], "1 of 5 reads failed"),
        (["broken off", "broken off", "answered"], "2 of 5 reads broke off"),
        (["broken off", "answered", "broken off", "answered"], "2 of 6 reads broke off"),
        (["answered", "broken off"], "no read was answered at the end, of 4"),
    ],
)
def test_everything_else_is_a_failure(reads: ModuleType, ending: list[str], words: str) -> None:
    assert reads.describe_violation(["answered", "answered", *ending]).startswith(words)


def test_no_read_at_all_is_a_failure(reads: ModuleType) -> None:
    assert reads.describe_violation([])
