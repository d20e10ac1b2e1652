"""Requests in the same words: what is answered without the whole way is what the whole way answers."""

import asyncio
import contextlib
import socket
from collections.abc import Iterator
from functools import partial

import httpx
import pytest
from actor import Actor, stage
from browser import LF, Browser
from running import eventually
from serving import connect, run, serving, until
from small_fleet import Place
from starlette.types import Receive, Scope, Send

from gateway.fleet.observation import Observation
from gateway.http.protocol import HttpProtocol
from gateway.http.rates import Rates
from gateway.http.repeats import MAX_KEPT, Repeat, Repeats
from gateway.rdf.graph import Graph
from gateway.rdf.vocabulary import LF as TERMS
from gateway.resources.property import Seen
from gateway.resources.resource import Resource
from gateway.resources.template import Rendering
from gateway.resources.versioning import Source
from gateway.runtime.counters import Requests

pytestmark = pytest.mark.virtual

Answer = tuple[bytes, dict[bytes, bytes], bytes]
_GET = b"GET /odd/elbow/rotation HTTP/1.1\r\nHost: %b\r\n%b\r\n"


class Connection:
    """One kept-alive connection, by hand."""

    def __init__(self, root: str) -> None:
        url = httpx.URL(root)
        self.host = url.netloc
        self._socket = socket.create_connection((url.host, url.port), timeout=20)
        self._file = self._socket.makefile("rb")

    def send(self, data: bytes) -> None:
        self._socket.sendall(data)

    def read(self) -> Answer:
        status, fields = self._file.readline().strip(), {}
        while line := self._file.readline().strip():
            name, _, value = line.partition(b": ")
            fields[name] = value
        return status, fields, self._file.read(int(fields.get(b"content-length", b"0")))

    def ask(self, fields: bytes = b"") -> Answer:
        self.send(_GET % (self.host, fields))
        return self.read()

    def close(self) -> None:
        self._file.close()
        self._socket.close()


class Stand:
    """A robot whose elbow stands where it is told to."""

    def __init__(self, root: str, browser: Browser, actor: Actor) -> None:
        self.root, self.browser, self.actor = root, browser, actor

    @property
    def found(self) -> bool:
        return self._get().status_code == 200

    def at(self, angle: float) -> None:
        """Until it is seen, in words of which nothing is kept."""
        eventually(lambda: self._shows(angle), f"the elbow at {angle}")

    def _shows(self, angle: float) -> bool:
        self.actor.put("state", self.actor.frame((angle,)))
        return f'"{angle!r}"' in self._get().text

    def _get(self) -> httpx.Response:
        fields = {"accept": "text/turtle", "x-way": "whole"}
        return self.browser.http.get(f"{self.root}odd/elbow/rotation", headers=fields)


@pytest.fixture(scope="module")
def stand(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Stand]:
    place = Place(tmp_path_factory.mktemp("repeats"))
    with place.gateway() as (_, browser), stage(place.zenoh) as session:
        found = Stand(place.root, browser, Actor(session, "odd").appear())
        eventually(lambda: found.found, "the robot")
        yield found


@pytest.fixture
def connection(stand: Stand) -> Iterator[Connection]:
    with contextlib.closing(Connection(stand.root)) as found:
        yield found


def without_id(answer: Answer) -> Answer:
    status, fields, body = answer
    kept = {name: value for name, value in fields.items() if name not in (b"x-request-id", b"date")}
    return status, kept, body


@pytest.mark.parametrize(
    "fields",
    [
        b"",
        b"Accept: text/turtle\r\n",
        b"Accept: application/ld+json\r\nConnection: keep-alive\r\n",
        b"Accept: application/rdf+xml;q=0.5, application/n-triples\r\nAccept-Encoding: gzip\r\n",
        b"Accept: text/html\r\n",
        b"Accept: image/png\r\n",
        b'If-None-Match: "another"\r\n',
        b"If-None-Match: *\r\n",
        b"X-Request-Id: my-own\r\n",
    ],
)
def test_it_is_the_same_answer_each_time(stand: Stand, connection: Connection, fields: bytes) -> None:
    stand.at(0.25)
    first, *others = [connection.ask(fields) for _ in range(4)]
    assert [without_id(each) for each in others] == [without_id(first)] * 3
    ids = {each[1][b"x-request-id"] for each in (first, *others)}
    assert len(ids) == (1 if b"X-Request-Id" in fields else 4)


def test_it_is_the_present_value(stand: Stand, connection: Connection) -> None:
    for angle in (0.5, 0.75, 0.5):
        stand.at(angle)
        asked = [connection.ask() for _ in range(3)]
        assert all(f'"{angle!r}"'.encode() in body for _, _, body in asked)
        assert len({fields[b"etag"] for _, fields, _ in asked}) == 1


def test_what_the_client_has_is_not_sent_again_until_it_is_another(stand: Stand, connection: Connection) -> None:
    stand.at(0.125)
    mine = b"If-None-Match: %b\r\n" % connection.ask()[1][b"etag"]
    assert [connection.ask(mine)[0] for _ in range(3)] == [b"HTTP/1.1 304 Not Modified"] * 3
    stand.at(0.375)
    changed = [connection.ask(mine) for _ in range(3)]
    assert all(status == b"HTTP/1.1 200 OK" and b'"0.375"' in body for status, _, body in changed)


def test_how_requests_come_in_pieces_makes_no_difference(stand: Stand, connection: Connection) -> None:
    stand.at(0.25)
    expected = without_id(connection.ask())
    request = _GET % (connection.host, b"")
    connection.send(request[:20])
    connection.send(request[20:])
    assert without_id(connection.read()) == expected
    for _ in range(3):
        connection.send(request + request + request[:9])
        connection.send(request[9:])
        assert [without_id(connection.read()) for _ in range(3)] == [expected] * 3


def test_two_requests_without_carriage_returns_are_two(stand: Stand, connection: Connection) -> None:
    """Together they end like one, and are taken apart all the same, the first time and every other."""
    stand.at(0.25)
    bare = (_GET % (connection.host, b"")).replace(b"\r\n", b"\n")
    for _ in range(3):
        connection.send(bare + _GET % (connection.host, b""))
        assert [connection.read()[0] for _ in range(2)] == [b"HTTP/1.1 200 OK"] * 2


def test_a_robot_that_left_is_offline_in_the_next_answer(stand: Stand, connection: Connection) -> None:
    stand.at(0.25)
    assert LF.offline.encode() not in connection.ask(b"Accept: application/n-triples\r\n")[2]
    stand.actor.leave()
    eventually(
        lambda: LF.offline.encode() in connection.ask(b"Accept: application/n-triples\r\n")[2], "offline in an answer"
    )
    stand.actor.appear()
    eventually(
        lambda: LF.offline.encode() not in connection.ask(b"Accept: application/n-triples\r\n")[2], "online again"
    )


# -- by itself ---------------------------------------------------------------------------------------------------------


def _repeat(holds: bool = True) -> Repeat:
    seen = (Observation((0.5,), 1),)

    def describe(graph: Graph, seen: Seen) -> None:
        graph.result_time(TERMS.value, seen.wall_ns)

    resource = Resource("/r/x", "x", None, source=Source(look=lambda: seen), measured=describe)
    repeat = Repeat(resource, Rendering(resource, "text/turtle", "http://test"), None, None, lambda: holds)
    assert repeat.answered(200, [(b"ETag", b"old"), (b"Content-Length", b"7"), (b"link", b"<x>")])
    return repeat


def test_what_holds_no_longer_is_forgotten() -> None:
    repeats = Repeats(Rates(0), Requests())
    repeats.keep(b"good", _repeat())
    repeats.keep(b"bad", _repeat(holds=False))
    assert repeats.answer(b"good", "", []) is not None
    assert repeats.answer(b"bad", "", []) is None
    assert repeats.known(b"bad") is None


def test_it_counts_as_any_request() -> None:
    requests, rates = Requests(), Rates(0.2, clock_s=lambda: 0.0)
    repeats = Repeats(rates, requests)
    repeats.keep(b"head", _repeat())
    assert [repeats.answer(b"head", "a", []) is not None for _ in range(3)] == [True, True, False]
    assert repeats.answer(b"head", "b", []) is not None
    assert requests.answered["GET", "2xx"] == 3


def test_there_are_never_too_many() -> None:
    repeats, repeat = Repeats(Rates(0), Requests()), _repeat()
    for number in range(MAX_KEPT + 5):
        repeats.keep(b"%d" % number, repeat)
    assert repeats.known(b"4") is None
    assert repeats.known(b"5") is not None


def test_fields_that_a_line_cannot_hold_are_not_kept() -> None:
    assert not _repeat().answered(200, [(b"link", b"a\r\nset-cookie: b")])
    assert not _repeat().answered(404, [])


class Hasty(HttpProtocol):
    head_s = 0.2


async def _nobody(scope: Scope, receive: Receive, send: Send) -> None:
    raise AssertionError("what is known is answered without the application")


def test_who_repeats_keeps_his_connection_and_who_falls_silent_loses_it() -> None:
    async def main() -> None:
        request, repeats = b"GET /r/x HTTP/1.1\r\nHost: test\r\n\r\n", Repeats(Rates(0), Requests())
        repeats.keep(request, _repeat())
        async with serving(_nobody, partial(Hasty, repeats=repeats)) as (server, port):  # type: ignore[arg-type]
            reader, writer = await connect(port, b"")
            with contextlib.closing(writer):
                for _ in range(10):  # longer than anybody may take to begin
                    writer.write(request)
                    head = await reader.readuntil(b"\r\n\r\n")
                    assert head.startswith(b"HTTP/1.1 200 OK\r\n")
                    await reader.readexactly(int(head.partition(b"content-length: ")[2].split()[0]))
                    await asyncio.sleep(0.05)
                await until(lambda: not server.server_state.connections)

    run(main)
