"""Findings of fuzzing, each with the shortest input that reproduces it."""

import socket
from collections.abc import Iterator

import pytest

from fuzzing.bodies import path_of
from fuzzing.findings import Tally
from fuzzing.living import LiveGateway, living

pytestmark = [pytest.mark.processes, pytest.mark.test_all]


@pytest.fixture(scope="module")
def there() -> Iterator[LiveGateway]:
    with living() as there:
        yield there


def said(there: LiveGateway, *pieces: bytes) -> bytes:
    """Return all responses to these pieces, after which the client closes its half."""
    with socket.create_connection(("127.0.0.1", there.port), timeout=30) as connection:
        heard = b""
        for piece in pieces[:-1]:
            connection.sendall(piece)
            heard += connection.recv(65_536)
        connection.sendall(pieces[-1])
        connection.shutdown(socket.SHUT_WR)
        while more := connection.recv(65_536):
            heard += more
        return heard


def calm(there: LiveGateway) -> None:
    """Check that the gateway responds and has logged no error, including about the last input."""
    there.probe()
    tally = Tally("found", 0)
    there.look(tally, 0, 1)
    assert not tally.findings, tally.findings


def test_a_client_that_disconnects_within_a_body_is_no_error(there: LiveGateway) -> None:
    for path in (path_of("rotate"), path_of("title")):
        head = f"PUT {path} HTTP/1.1\r\nHost: 127.0.0.1:{there.port}\r\nContent-Type: text/turtle\r\n"
        assert said(there, f"{head}Content-Length: 50\r\n\r\n<> ".encode()) == b""
    calm(there)


def test_a_ping_after_a_refused_message_is_no_error(there: LiveGateway) -> None:
    """Both in one piece: after the first, the gateway writes nothing any more."""
    head = (
        f"GET /arm/pan/rotation HTTP/1.1\r\nHost: 127.0.0.1:{there.port}\r\nConnection: Upgrade\r\nUpgrade: websocket"
    )
    key = "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\nSec-WebSocket-Version: 13"
    text, ping = b"\x81\x81\0\0\0\0x", b"\x89\x80\0\0\0\0"
    heard = said(there, f"{head}\r\n{key}\r\n\r\n".encode(), text + ping)
    assert heard.startswith(b"HTTP/1.1 101")
    assert b"this channel only sends" in heard
    calm(there)


def test_a_bad_chunk_before_the_answer_is_answered_once(there: LiveGateway) -> None:
    """The request gets 400, and no response of the application."""
    head = f"PUT {path_of('rotate')} HTTP/1.1\r\nHost: 127.0.0.1:{there.port}\r\nContent-Type: text/turtle"
    for more in ("", "\r\nHost: x"):  # refused at once, while the other response is on its way
        heard = said(there, f"{head}{more}\r\nTransfer-Encoding: chunked\r\n\r\nx\r\n".encode())
        assert heard.startswith(b"HTTP/1.1 400") and heard.count(b"HTTP/1.1 ") == 1, heard
    calm(there)


def test_a_bad_chunk_of_a_head_is_answered_without_a_body(there: LiveGateway) -> None:
    head = f"HEAD / HTTP/1.1\r\nHost: 127.0.0.1:{there.port}\r\nTransfer-Encoding: chunked\r\n\r\n"
    heard = said(there, f"{head}1\r\nxxx\r\n".encode())
    assert heard.startswith(b"HTTP/1.1 400") and heard.endswith(b"\r\n\r\n"), heard
    calm(there)


def test_a_bad_chunk_after_the_answer_ends_the_connection(there: LiveGateway) -> None:
    head = f"PUT {path_of('rotate')} HTTP/1.1\r\nHost: 127.0.0.1:{there.port}\r\nContent-Type: x"
    heard = said(there, f"{head}\r\nTransfer-Encoding: chunked\r\n\r\n".encode(), b"x\r\n")
    assert heard.startswith(b"HTTP/1.1 4") and heard.count(b"HTTP/1.1 ") == 1, heard
    calm(there)


def test_an_opening_that_only_the_parser_of_websockets_refuses_is_answered(there: LiveGateway) -> None:
    head = f"GET /arm/pan/rotation HTTP/1.1\r\nHost: 127.0.0.1:{there.port}\r\nConnection: Upgrade"
    heard = said(there, f"{head}\r\nUpgrade: websocket\r\nSec-WebSocket-Key: a\x1eb\r\n\r\n".encode())
    assert heard.startswith(b"HTTP/1.1 400"), heard
    calm(there)
