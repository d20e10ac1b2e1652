"""RFC 9110, 7.2 and 7.4: the authority of a request."""

import asyncio
import json

import pytest
from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import PlainTextResponse
from starlette.routing import Route
from starlette.types import Scope

from linked_fleet_base.errors import FleetError, MisdirectedRequest
from linked_fleet_gateway.http.arrival import arrival_of
from linked_fleet_gateway.http.forwarding import Authorities, Message, send_problem

URLS = ("http://127.0.0.1:8000", "https://Fleet.example/", "http://[::1]:8000")


async def base(request: Request) -> PlainTextResponse:
    return PlainTextResponse(arrival_of(request.scope).base)


def ask(*hosts: str, kind: str = "http", more: tuple[tuple[bytes, bytes], ...] = (), **extra: object) -> list[Message]:
    """Return the response of the application to a request with these Host and further fields."""
    sent: list[Message] = []

    async def receive() -> Message:
        return {"type": "http.request", "body": b"", "more_body": False}

    async def send(message: Message) -> None:
        sent.append(message)

    headers = [*((b"host", host.encode("latin-1")) for host in hosts), *more]
    scope: Scope = {"type": kind, "method": "GET", "path": "/", "headers": headers, "query_string": b"", **extra}
    app = Starlette(routes=[Route("/", base, methods=["GET", "HEAD", "OPTIONS", "POST", "PUT", "DELETE"])])

    async def answer() -> None:
        try:
            Authorities(URLS).check_authority(scope)
        except FleetError as error:
            await send_problem(error, scope, send)
        else:
            await app(scope, receive, send)

    asyncio.run(answer())
    return sent


@pytest.mark.parametrize(
    ("host", "expected"),
    [
        ("127.0.0.1:8000", "http://127.0.0.1:8000"),
        ("fleet.example", "https://Fleet.example"),
        ("FLEET.example:443", "https://Fleet.example"),
        ("fleet.example:", "https://Fleet.example"),
        ("[::1]:8000", "http://[::1]:8000"),
    ],
)
def test_known_authority(host: str, expected: str) -> None:
    """Case and default ports are ignored; the base is the public URL, never the header."""
    assert ask(host)[1]["body"].decode() == expected


@pytest.mark.parametrize(
    "hosts", [(), ("http://example.org",), ("a", "a"), ("",), ("a b",), ("a/b",), ("u@a",), ("é",), ("a:x",)]
)
def test_malformed(hosts: tuple[str, ...]) -> None:
    """No Host, two of them or an invalid one: 400."""
    start, body = ask(*hosts)
    assert start["status"] == 400 and json.loads(body["body"])["status"] == 400


@pytest.mark.parametrize("host", ["evil.example", "127.0.0.1", "fleet.example:80", "127.0.0.1:99999"])
def test_unknown_authority(host: str) -> None:
    """421 that lists the known authorities."""
    start, body = ask(host)
    assert start["status"] == 421 and "http://127.0.0.1:8000" in json.loads(body["body"])["detail"]


def test_a_refused_host_is_refused_again() -> None:
    """A request is looked at a second time where its answer is not there at once."""
    headers = [(b"host", b"fleet.example")]
    scope: Scope = {
        "type": "http",
        "method": "GET",
        "raw_path": b"http://evil.example/x",
        "path": "",
        "headers": headers,
    }
    for _ in range(2):
        with pytest.raises(MisdirectedRequest):
            Authorities(URLS).check_authority(scope)


def test_websocket() -> None:
    """A handshake is refused likewise if the server can do so, else closed."""
    assert ask("evil.example", kind="websocket", extensions={"websocket.http.response": {}})[0]["status"] == 421
    assert ask("evil.example", kind="websocket") == [{"type": "websocket.close", "code": 1008}]


@pytest.mark.parametrize("method", ["POST", "PUT", "DELETE"])
@pytest.mark.parametrize(
    ("origins", "status"),
    [
        ((), 200),
        ((b"http://127.0.0.1:8000",), 200),
        ((b"https://fleet.example",), 200),
        ((b"http://127.0.0.1:9000",), 403),
        ((b"https://127.0.0.1:8000",), 403),
        ((b"https://fleet.example.evil.example",), 403),
        ((b"null",), 403),
        ((b"",), 403),
        ((b"http://127.0.0.1:8000", b"http://evil.example"), 403),
    ],
)
def test_pages_of_other_sites_do_nothing(method: str, origins: tuple[bytes, ...], status: int) -> None:
    more = tuple((b"origin", each) for each in origins)
    assert ask("127.0.0.1:8000", method=method, more=more)[0]["status"] == status


def test_pages_of_other_sites_read_and_do_not_listen() -> None:
    """Cross-origin reads are permitted, because the browser decides who sees the response."""
    foreign = ((b"origin", b"http://evil.example"),)
    assert ask("127.0.0.1:8000", more=foreign)[0]["status"] == 200
    for accept in (b"text/event-stream", b"Text/Event-Stream"):
        events = ask("127.0.0.1:8000", more=(*foreign, (b"accept", accept)))
        problem = json.loads(events[1]["body"])["type"].rpartition("#")[2]
        assert (events[0]["status"], problem) == (403, "foreign-origin")
    (close,) = ask("127.0.0.1:8000", kind="websocket", more=foreign)
    assert close == {"type": "websocket.close", "code": 1008}
