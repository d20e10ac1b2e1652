"""Replies that are there when the request has come: in order, one for each reading, framed and bounded as any other."""

import asyncio
from functools import partial
from typing import Any

import pytest
from starlette.requests import Request
from starlette.responses import Response
from starlette.types import Receive, Scope, Send

from linked_fleet_server.exchange import Reply
from linked_fleet_server.message_heads import field_block
from linked_fleet_server.protocol import HttpProtocol
from serving import connect, serving, until

pytestmark = pytest.mark.virtual
_KEPT = (b"vary", b"Accept")
_GET = "GET /{} HTTP/1.1\r\nHost: test\r\n\r\n"


class _Hasty(HttpProtocol):
    head_s = 0.3


async def _application(scope: Scope, receive: Receive, send: Send) -> None:
    await Response(b"application" + await Request(scope, receive).body())(scope, receive, send)


def _at_once(scope: Scope) -> Reply | None:
    """Has the reply to all paths but /other; of a client that has it a 304."""
    if scope["path"] == "/other":
        return None
    known = any(name == b"if-none-match" for name, _ in scope["headers"])
    length = [] if known else [(b"content-length", b"4")]
    return Reply(304 if known else 200, field_block([_KEPT, *length]), b"" if known else b"kept")


def _http(protocol: type[HttpProtocol] = HttpProtocol) -> Any:
    return partial(protocol, reply_nowait=_at_once)


async def _answers(requests: str) -> bytes:
    """Return all that comes back before the connection ends."""
    async with serving(_application, http=_http()) as (_, port):
        reader, writer = await connect(port, requests.encode())
        found = await reader.read()
        writer.close()
        return found


_LAST = _GET.format("other").replace("\r\n\r\n", "\r\nConnection: close\r\n\r\n")


async def test_answers_come_in_the_order_of_the_requests() -> None:
    answers = await _answers(_GET.format("a") + _GET.format("other") + _GET.format("b") + _LAST)
    assert [part.partition(b"\r\n\r\n")[2] for part in answers.split(b"HTTP/1.1 ")[1:]] == [
        b"kept", b"application", b"application", b"application",
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("request_text", "end"),
    [
        ("HEAD / HTTP/1.1\r\nHost: test\r\nConnection: close\r\n\r\n", b"connection: close\r\n\r\n"),
        ("GET / HTTP/1.1\r\nHost: test\r\nConnection: close\r\n\r\n", b"connection: close\r\n\r\nkept"),
        ("GET / HTTP/1.0\r\nHost: test\r\n\r\n", b"connection: close\r\n\r\nkept"),
        ('GET / HTTP/1.1\r\nHost: test\r\nIf-None-Match: "x"\r\nConnection: close\r\n\r\n', b"close\r\n\r\n"),
    ],
)
async def test_immediate_responses_are_framed_as_others(request_text: str, end: bytes) -> None:
    answer = await _answers(request_text)
    assert answer.startswith((b"HTTP/1.1 200 OK\r\n", b"HTTP/1.1 304 Not Modified\r\n"))
    assert b"\r\nvary: Accept\r\n" in answer and b"\r\ndate: " in answer
    assert answer.endswith(end)


async def test_a_request_with_content_is_left_to_the_application() -> None:
    answers = await _answers("GET / HTTP/1.1\r\nHost: test\r\nContent-Length: 3\r\n\r\nabc" + _LAST)
    assert answers.count(b"applicationabc") == 1 and b"kept" not in answers


async def test_nothing_after_the_last_request_is_answered_or_run() -> None:
    """RFC 9112, 9.6: a server processes no request after one with Connection: close."""
    ran = list[str]()

    async def app(scope: Scope, receive: Receive, send: Send) -> None:
        ran.append(scope["path"])
        await Response(b"application")(scope, receive, send)

    last = _GET.format("a").replace("\r\n\r\n", "\r\nConnection: close\r\n\r\n")
    post = "POST /b HTTP/1.1\r\nHost: test\r\nContent-Length: 3\r\n\r\nabc"
    async with serving(app, http=_http()) as (server, port):
        reader, writer = await connect(port, (last + post + _GET.format("c")).encode())
        assert (await reader.read()).endswith(b"kept")
        await until(lambda: not server.server_state.connections)
        assert ran == []
        writer.close()


async def test_the_application_answers_when_an_immediate_response_fails(caplog: pytest.LogCaptureFixture) -> None:
    def broken(scope: Scope) -> Reply | None:
        raise LookupError("no such thing")

    http: Any = partial(HttpProtocol, reply_nowait=broken)
    async with serving(_application, http=http) as (_, port):
        reader, writer = await connect(port, _LAST.encode())
        assert (await reader.read()).endswith(b"application")
        writer.close()
    assert "no such thing" in caplog.text


async def test_the_next_request_may_take_its_time_from_the_answer_on() -> None:
    """A connection that is used again and again is open for longer than a client may take for one request."""
    async with serving(_application, http=_http(_Hasty)) as (_, port):
        reader, writer = await connect(port, b"")
        for _ in range(5):
            await asyncio.sleep(0.8 * _Hasty.head_s)
            writer.write(_GET.format("a").encode())
            assert (await reader.readuntil(b"kept")).startswith(b"HTTP/1.1 200")
        with pytest.raises(ConnectionError):  # from here on nothing is asked for, and the connection ends
            await reader.read()
        writer.close()


def test_no_field_begins_another() -> None:
    with pytest.raises(RuntimeError):
        field_block([(b"x", b"a\r\nset-cookie: b")])
