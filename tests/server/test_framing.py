"""Requests whose version or framing is refused (RFC 9110, 15.6.6; RFC 9112, 6.1)."""

import asyncio

import pytest
from starlette.requests import Request
from starlette.responses import Response
from starlette.types import Receive, Scope, Send

from serving import connect, serving

pytestmark = pytest.mark.virtual
_BOTH = "POST / HTTP/1.1\r\nHost: test\r\nContent-Length: 5\r\nTransfer-Encoding: chunked\r\n\r\n0\r\n\r\n"
_REORDERED = "POST / HTTP/1.1\r\nHost: test\r\ntransfer-encoding: Chunked\r\nContent-Length: 0\r\n\r\n0\r\n\r\n"
_TWICE = "POST / HTTP/1.1\r\nHost: test" + 2 * "\r\nTransfer-Encoding: chunked" + "\r\n\r\n0\r\n\r\n"
_OLD = "POST / HTTP/1.0\r\nHost: test\r\nTransfer-Encoding: chunked\r\n\r\n0\r\n\r\n"


@pytest.mark.parametrize(
    ("request_text", "status"),
    [
        (_BOTH, b"400"),
        (_REORDERED, b"400"),
        (_OLD, b"400"),
        (_TWICE, b"400"),
        ("GET / HTTP/9.1\r\nHost: test\r\n\r\n", b"505"),
        ("GET / HTTP/2.0\r\nHost: test\r\n\r\n", b"505"),
        ("GET / HTTP/0.9\r\nHost: test\r\n\r\n", b"505"),
    ],
)
async def test_a_refused_request_ends_its_connection(request_text: str, status: bytes) -> None:
    """The application sees neither the refused request nor one that follows on the same connection."""
    async with serving(Response(b"application")) as (_, port):
        follower = "GET / HTTP/1.1\r\nHost: test\r\n\r\n"
        reader, writer = await connect(port, (request_text + follower).encode())
        answer = await reader.read()
        writer.close()
        assert answer.split()[1] == status
        assert answer.count(b"HTTP/1.1 ") == 1
        assert b"connection: close" in answer.lower()
        assert b"application" not in answer


@pytest.mark.parametrize("version", ["1.0", "1.1", "1.5"])
async def test_http_1_is_served(version: str) -> None:
    """Each minor version of HTTP/1 is answered by the application (RFC 9110, 2.5)."""
    async with serving(Response(b"application")) as (_, port):
        request = f"GET / HTTP/{version}\r\nHost: test\r\nConnection: close\r\n\r\n"
        reader, writer = await connect(port, request.encode())
        assert (await reader.read()).endswith(b"application")
        writer.close()


@pytest.mark.parametrize("more", [b"no request\r\n\r\n", b"\r\n\r\n", b"GET /b HTTP/1.1\r\nHost: test\r\n\r\n"])
@pytest.mark.parametrize("at_once", [True, False])
async def test_what_follows_the_last_request_is_ignored(more: bytes, at_once: bool) -> None:
    """RFC 9112, 9.6: and the request is answered."""
    entered, go = asyncio.Event(), asyncio.Event()

    async def app(scope: Scope, receive: Receive, send: Send) -> None:
        assert scope["path"] == "/a"
        entered.set()
        await go.wait()
        await Response(b"application")(scope, receive, send)

    async with serving(app) as (_, port):
        last = b"GET /a HTTP/1.1\r\nHost: test\r\nConnection: close\r\n\r\n"
        reader, writer = await connect(port, last + more if at_once else last)
        await entered.wait()
        if not at_once:
            writer.write(more)
            await asyncio.sleep(0.1)
        go.set()
        answer = await reader.read()
        assert (answer.split()[1], answer.count(b"HTTP/1.1 "), answer[-11:]) == (b"200", 1, b"application")
        writer.close()


@pytest.mark.parametrize(("version", "interim"), [("1.0", 0), ("1.1", 1)])
async def test_100_continue_is_sent_when_the_body_is_read(version: str, interim: int) -> None:
    """RFC 9110, 10.1.1: and never to HTTP/1.0."""

    async def echo(scope: Scope, receive: Receive, send: Send) -> None:
        await Response(await Request(scope, receive).body())(scope, receive, send)

    async with serving(echo) as (_, port):
        head = f"POST / HTTP/{version}\r\nHost: test\r\nContent-Length: 3\r\nExpect: 100-Continue\r\n"
        reader, writer = await connect(port, (head + "Connection: close\r\n\r\n").encode())
        if interim:
            assert await reader.readuntil(b"\r\n\r\n") == b"HTTP/1.1 100 Continue\r\n\r\n"
        writer.write(b"abc")
        answer = await reader.read()
        assert (answer.split()[1], answer[-7:]) == (b"200", b"\r\n\r\nabc")
        writer.close()
