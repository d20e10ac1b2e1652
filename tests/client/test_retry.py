"""Which requests are sent again, how often and after which pauses."""

import contextlib
import threading
import time
from collections.abc import Iterator
from email.utils import formatdate
from typing import Any

import pytest

from linked_fleet_client import live, retry, web
from linked_fleet_client.action import Action
from linked_fleet_client.errors import ClientError, Problem
from linked_fleet_client.fleet import Fleet
from linked_fleet_client.invocation import Invocation
from linked_fleet_client.live import Feed
from linked_fleet_client.retry import ATTEMPTS, Attempts, Repeat, parse_retry_after
from linked_fleet_client.web import Web

NOW_S = 1_000_000.0
KEY = {"idempotency-key": "k"}
OK = b"HTTP/1.1 204 X\r\nconnection: close\r\n\r\n"
READ = b"HTTP/1.1 200 X\r\ncontent-type: text/turtle\r\ncontent-length: 0\r\nconnection: close\r\n\r\n"
BROKEN = b""


class Clock:
    """The module ``time`` for the thread of a test, whose sleeps are noted and take no time.

    A feed that another test has left running sleeps as ever.
    """

    def __init__(self) -> None:
        self.slept: list[float] = []
        self._thread = threading.get_ident()

    def sleep(self, seconds: float) -> None:
        if threading.get_ident() == self._thread:
            self.slept.append(seconds)
        else:
            time.sleep(seconds)

    def time(self) -> float:
        return NOW_S + sum(self.slept)

    monotonic = time


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    clock = Clock()
    for module in (web, retry, live):
        monkeypatch.setattr(module, "time", clock)
    return clock


@pytest.fixture
def client() -> Iterator[Web]:
    client = Web(timeout_s=5)
    yield client
    client.close()


def refusal(status: int, after: str | None = None) -> bytes:
    told = "" if after is None else f"retry-after: {after}\r\n"
    return f"HTTP/1.1 {status} X\r\n{told}content-length: 0\r\nconnection: close\r\n\r\n".encode()


@pytest.mark.parametrize(
    ("method", "fields", "repeat", "answers", "pauses", "succeeds"),
    [
        ("GET", {}, None, [refusal(503, "2"), READ], [2.0], True),
        ("GET", {}, None, [refusal(503), READ], [0.1], True),
        ("GET", {}, None, [BROKEN, READ], [0.1], True),
        ("GET", {}, None, [refusal(429, "1"), READ], [1.0], True),
        ("GET", {}, None, [refusal(429), READ], [], False),
        ("GET", {}, None, [refusal(503, "0"), READ], [0.1], True),
        ("GET", {}, None, [refusal(503, formatdate(NOW_S + 3, usegmt=True)), READ], [3.0], True),
        ("GET", {}, None, [refusal(503, formatdate(NOW_S - 3, usegmt=True)), READ], [0.1], True),
        ("GET", {}, None, [refusal(503, "soon"), READ], [0.1], True),
        ("GET", {}, None, [refusal(503, "1")], [1.0] * (ATTEMPTS - 1), False),
        ("GET", {}, None, [refusal(503, "6")], [6.0, 6.0], False),
        ("GET", {}, None, [refusal(503, "16"), READ], [], False),
        ("GET", {}, None, [refusal(404, "1"), READ], [], False),
        ("PUT", {}, None, [refusal(503, "2"), OK], [2.0], True),
        ("PUT", {}, None, [refusal(503), OK], [], False),
        ("PUT", {}, None, [BROKEN, OK], [], False),
        ("DELETE", {}, None, [refusal(503, "2"), OK], [2.0], True),
        ("POST", {}, None, [refusal(503, "2"), OK], [], False),
        ("POST", KEY, None, [refusal(503, "2"), OK], [2.0], True),
        ("POST", KEY, None, [refusal(504, "2"), OK], [], False),
        ("POST", KEY, None, [BROKEN, OK], [], False),
        ("PUT", {}, Repeat.NEVER, [refusal(503, "2"), OK], [], False),
        ("POST", {}, Repeat.STOP, [refusal(503, "9"), refusal(503, "9"), OK], [0.0, 0.0], True),
        ("POST", {}, Repeat.STOP, [BROKEN, refusal(502), OK], [0.0, 0.0], True),
        ("POST", {}, Repeat.STOP, [refusal(503)], [0.0, 0.0], False),
        ("POST", {}, Repeat.STOP, [refusal(504), OK], [], False),
    ],
)
def test_a_request_is_repeated_within_bounds(
    script: Any, client: Web, clock: Clock, method: str, fields: dict[str, str], repeat: Repeat | None,
    answers: list[bytes], pauses: list[float], succeeds: bool,
) -> None:  # fmt: skip
    """As long as the server wants, within the patience; a stop at once; an action never after a broken connection."""
    script.answers["/x"] = list(answers)
    url = f"{script.url}/x"
    try:
        client.get(url) if method == "GET" else client.send(method, url, b"", fields, repeat)
        succeeded = True
    except ClientError:
        succeeded = False
    assert (clock.slept, succeeded) == (pauses, succeeds)
    assert len(script.at("/x")) == len(pauses) + 1
    assert sum(clock.slept) <= client.patience_s


def test_without_patience_the_refusal_comes_at_once(script: Any, clock: Clock) -> None:
    script.answers["/x"] = [refusal(503, "1"), READ]
    with Fleet(f"{script.url}/x", patience_s=0) as fleet, pytest.raises(Problem, match="503"):
        fleet.read()
    assert clock.slept == []


def test_a_feed_stays_away_as_long_as_the_server_wants(script: Any, client: Web, clock: Clock) -> None:
    over = b"HTTP/1.1 204 No Content\r\nconnection: close\r\n\r\n"
    script.answers["/x"] = [refusal(503, "7"), over]
    assert list(Feed(client, f"{script.url}/x")) == []
    assert sum(clock.slept) == pytest.approx(7.0)


@pytest.mark.parametrize("field", [None, "", "-1", "1.5", "Never", "²", "Sat, 99 Nov 2026 09:00:00 GMT"])
def test_a_field_that_is_no_time_is_ignored(field: str | None) -> None:
    assert parse_retry_after(field) is None


def test_a_huge_number_of_seconds_is_beyond_any_patience() -> None:
    assert Attempts(Repeat.SAFE, 15.0).pause_s(503, "9" * 5000) is None


ACTION = """@prefix lf: <https://w3id.org/linked-fleet#> . @prefix hybrit: <https://hybr-it-projekt.de/ns/hybr-it#> .
@prefix http: <http://www.w3.org/2011/http#> . @prefix dcterms: <http://purl.org/dc/terms/> .
</a> a hybrit:Action, {} ; hybrit:binding [ http:mthd "POST" ; http:requestURI </run> ] ."""


@pytest.mark.parametrize(
    ("kind", "repeated"),
    [
        ("lf:StopRobot", True),
        ("lf:StopAll", True),
        ("lf:Hold", True),
        ("lf:CancelInvocation", True),
        ('<urn:x> ; dcterms:identifier "stopEverything"', True),
        ('<urn:x> ; dcterms:title "Cancel"', True),
        ("lf:RotateBy", False),
        ('<urn:x> ; dcterms:identifier "nonstop"', False),
    ],
)
def test_actions_that_stop_are_repeated_at_once(script: Any, clock: Clock, kind: str, repeated: bool) -> None:
    """The vocabulary tells which they are, in others their names; no other action without a key is repeated."""
    body = ACTION.format(kind).encode()
    script.answers["/a"] = [READ.replace(b"length: 0", b"length: %d" % len(body)) + body]
    script.answers["/run"] = [refusal(503, "9"), OK]
    with Fleet(f"{script.url}/") as fleet:
        action = Action(fleet.web, f"{script.url}/a")
        with contextlib.nullcontext() if repeated else pytest.raises(Problem):
            action()
    assert (len(script.at("/run")), sum(clock.slept)) == (2 if repeated else 1, 0.0)


def test_an_invocation_is_cancelled_by_delete_at_once(script: Any, clock: Clock) -> None:
    script.answers["/i"] = [READ, READ, refusal(503, "9"), OK]
    with Fleet(f"{script.url}/") as fleet:
        Invocation(fleet.web, f"{script.url}/i", Action).cancel()
    assert (script.asked[-2][0], script.asked[-1][0], sum(clock.slept)) == ("DELETE", "DELETE", 0.0)
