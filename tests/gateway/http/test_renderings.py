"""GET of measured values: compiled renderings give the same response as the first one, with the present value."""

import contextlib
import socket
from collections.abc import Iterator, Sequence

import httpx
import pytest

from browser import LF, Browser
from fake_robots import FakeRobot, open_session
from linked_fleet_gateway.resources.description import MeasuredDescription
from linked_fleet_gateway.resources.property import Measurement
from linked_fleet_gateway.resources.resource import Resource
from linked_fleet_gateway.resources.templates import Templates
from linked_fleet_gateway.resources.versioning import Source
from linked_fleet_rdf.graph import Graph
from linked_fleet_rdf.vocabulary import LF as TERMS
from linked_fleet_state.observation import Observation
from running import eventually
from small_fleet import Place

pytestmark = pytest.mark.virtual

Answer = tuple[bytes, dict[bytes, bytes], bytes]
_GET = b"GET /odd/elbow/rotation HTTP/1.1\r\nHost: %b\r\n%b\r\n"


class Connection:
    """A raw connection that is kept alive."""

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
    """A robot whose elbow has the position that the test sets."""

    def __init__(self, root: str, browser: Browser, actor: FakeRobot) -> None:
        self.root, self.browser, self.actor = root, browser, actor

    @property
    def found(self) -> bool:
        return self._get().status_code == 200

    def at(self, angle: float) -> None:
        """Wait until a response shows this angle."""
        eventually(lambda: self._shows(angle), f"the elbow at {angle}")

    def _shows(self, angle: float) -> bool:
        self.actor.put("state", self.actor.frame((angle,)))
        return f'"{angle!r}"' in self._get().text

    def _get(self) -> httpx.Response:
        return self.browser.http.get(f"{self.root}odd/elbow/rotation", headers={"accept": "text/turtle"})


@pytest.fixture(scope="module")
def stand(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Stand]:
    place = Place(tmp_path_factory.mktemp("renderings"))
    with place.gateway() as (_, browser), open_session(place.zenoh) as session:
        found = Stand(place.root, browser, FakeRobot(session, "odd").appear())
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
def test_compiled_responses_equal_each_other(stand: Stand, connection: Connection, fields: bytes) -> None:
    stand.at(0.25)
    first, *others = [connection.ask(fields) for _ in range(4)]
    assert [without_id(each) for each in others] == [without_id(first)] * 3
    ids = {each[1][b"x-request-id"] for each in (first, *others)}
    assert len(ids) == (1 if b"X-Request-Id" in fields else 4)


def test_compiled_responses_have_the_present_value(stand: Stand, connection: Connection) -> None:
    for angle in (0.5, 0.75, 0.5):
        stand.at(angle)
        asked = [connection.ask() for _ in range(3)]
        assert all(f'"{angle!r}"'.encode() in body for _, _, body in asked)
        assert len({fields[b"etag"] for _, fields, _ in asked}) == 1


def test_an_unchanged_representation_is_304(stand: Stand, connection: Connection) -> None:
    stand.at(0.125)
    mine = b"If-None-Match: %b\r\n" % connection.ask()[1][b"etag"]
    assert [connection.ask(mine)[0] for _ in range(3)] == [b"HTTP/1.1 304 Not Modified"] * 3
    stand.at(0.375)
    changed = [connection.ask(mine) for _ in range(3)]
    assert all(status == b"HTTP/1.1 200 OK" and b'"0.375"' in body for status, _, body in changed)


def test_split_requests_have_the_same_response(stand: Stand, connection: Connection) -> None:
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


def test_lines_without_carriage_returns_are_refused(stand: Stand, connection: Connection) -> None:
    """RFC 9112, 2.2 leaves it to the server; two ways to end a line are two ways to read a request."""
    stand.at(0.25)
    bare = (_GET % (connection.host, b"")).replace(b"\r\n", b"\n")
    connection.send(bare + _GET % (connection.host, b""))
    assert connection.read()[0] == b"HTTP/1.1 400 Bad Request"


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


def _resource(facts: object = ()) -> Resource:
    def describe(graph: Graph, measurements: Sequence[Measurement]) -> None:
        graph.result_time(TERMS.value, measurements[0].wall_ns)

    seen = (Observation((0.5,), 1),)
    return Resource(f"/r/{facts}", "x", MeasuredDescription(describe, (lambda: seen,)), source=Source(lambda: facts))


def test_there_are_never_too_many_renderings() -> None:
    renderings = Templates(max_renderings=3)
    for number in range(5):
        renderings.rendering(_resource(number), "text/turtle", "http://test")
    assert len(renderings) == 3
