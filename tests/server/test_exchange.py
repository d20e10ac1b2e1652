"""Applications that fail, or whose messages are out of turn, end their connection and harm no other."""

import asyncio

import pytest
from starlette.types import Message, Receive, Scope, Send

from serving import connect, serving, until

pytestmark = pytest.mark.virtual
_GET = b"GET / HTTP/1.1\r\nHost: test\r\n\r\n"
_START: Message = {"type": "http.response.start", "status": 200, "headers": [(b"content-length", b"3")]}
_BODY: Message = {"type": "http.response.body", "body": b"abc"}
_PART: Message = {"type": "http.response.body", "body": b"a", "more_body": True}


class App:
    """Sends messages, and then fails or returns."""

    def __init__(self, messages: list[Message], failure: Exception | None = None) -> None:
        self.messages, self.failure = messages, failure

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        for each in self.messages:
            await send(each)
        if self.failure is not None:
            raise self.failure


async def _answer(app: App, request: bytes = _GET) -> bytes:
    """Return everything that is sent before the connection ends; a request that follows is not answered."""
    async with serving(app) as (server, port):
        reader, writer = await connect(port, request + _GET)
        answer = await reader.read()
        await until(lambda: not server.server_state.connections and not server.server_state.tasks)
        writer.close()
        return answer


@pytest.mark.parametrize("failure", [LookupError("no such thing"), None])
async def test_no_response(failure: Exception | None, caplog: pytest.LogCaptureFixture) -> None:
    answer = await _answer(App([], failure))
    assert answer.startswith(b"HTTP/1.1 500 Internal Server Error\r\n")
    assert answer.endswith(b"\r\nconnection: close\r\n\r\nInternal Server Error")
    assert "no such thing" in caplog.text or "without a complete response" in caplog.text


async def test_no_response_to_head_has_no_content() -> None:
    assert (await _answer(App([]), _GET.replace(b"GET", b"HEAD"))).endswith(b"\r\nconnection: close\r\n\r\n")


@pytest.mark.parametrize("failure", [LookupError("no such thing"), None])
async def test_half_a_response_is_not_completed(failure: Exception | None) -> None:
    assert (await _answer(App([_START, _PART], failure))).endswith(b"\r\n\r\na")


@pytest.mark.parametrize("messages", [[_BODY], [_START, _START], [_START, {**_BODY, "body": b"abcd"}]])
async def test_messages_out_of_turn(messages: list[Message], caplog: pytest.LogCaptureFixture) -> None:
    assert b"abc" not in await _answer(App(messages))
    assert "RuntimeError" in caplog.text


async def test_a_shutdown_cancels_what_does_not_end() -> None:
    entered = asyncio.Event()

    async def app(scope: Scope, receive: Receive, send: Send) -> None:
        entered.set()
        await asyncio.Event().wait()

    async with serving(app) as (server, port):
        reader, writer = await connect(port, _GET)
        await entered.wait()
        server.should_exit = True
        assert (await reader.read()).startswith(b"HTTP/1.1 500")
        writer.close()
