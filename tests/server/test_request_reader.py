"""Requests are the same however their bytes are split."""

import pytest

from linked_fleet_server.message_heads import HeadError
from linked_fleet_server.request_reader import RequestReader

_GET = b"GET /a?b=c HTTP/1.1\r\nHost: test\r\nAccept: x\r\nACCEPT: y\r\n\r\n"
_POST = b"POST /b HTTP/1.1\r\nHost: test\r\nContent-Length: 3\r\n\r\nabc"
_CHUNKED = b"PUT /c HTTP/1.1\r\nHost: test\r\n\r\nPUT /d HTTP/1.1\r\nTransfer-Encoding: chunked\r\n\r\n"
_CHUNKS = b"1\r\na\r\n2;x=y\r\nbc\r\n0\r\nTrailer: z\r\n\r\n"
_UPGRADE = b"POST /e HTTP/1.1\r\nConnection: Upgrade\r\nUpgrade: h2c\r\nContent-Length: 3\r\n\r\nabc"
_OPENING = b"GET /f HTTP/1.1\r\nConnection: keep-alive, Upgrade\r\nUpgrade: WebSocket\r\nSec-WebSocket-Key: x\r\n\r\n"


class Handler:
    """Notes what it is told."""

    def __init__(self) -> None:
        self.told = list[str]()
        self.reader = RequestReader(self)

    def may_upgrade(self) -> bool:
        return True

    def on_request(self) -> None:
        reader = self.reader
        fields = {name.decode(): value.decode() for name, value in reader.fields.items()}
        self.told += [f"{reader.method} {reader.target.decode()} {reader.version} {fields} {reader.keep_alive}", ""]

    def on_content(self, data: bytes) -> None:
        self.told[-1] += data.decode()

    def on_request_end(self) -> None:
        self.told.append("end")


def _told(pieces: list[bytes]) -> list[str]:
    handler = Handler()
    for piece in pieces:
        assert handler.reader.feed(piece) is None
    assert not handler.reader.in_head and not handler.reader.in_body
    return handler.told


@pytest.mark.parametrize("data", [_GET, _POST, _CHUNKED + _CHUNKS, _UPGRADE, _UPGRADE + _GET, b"\r\n" + _GET + _POST])
def test_requests_do_not_depend_on_pieces(data: bytes) -> None:
    whole = _told([data])
    for end in range(1, len(data)):
        assert _told([data[:end], data[end:]]) == whole
    assert _told([bytes([each]) for each in data]) == whole


def test_what_is_read() -> None:
    assert _told([_GET + _UPGRADE]) == [
        "GET /a?b=c 1.1 {'host': 'test', 'accept': 'x, y'} True", "", "end",
        "POST /e 1.1 {'connection': 'Upgrade', 'upgrade': 'h2c', 'content-length': '3'} True", "abc", "end",
    ]  # fmt: skip


@pytest.mark.parametrize("rest", [b"", b"\x81\x00"])
def test_the_bytes_after_an_opening_handshake_are_returned(rest: bytes) -> None:
    handler = Handler()
    assert handler.reader.feed(_OPENING + rest) == rest
    assert handler.reader.opens_websocket and handler.told == []


@pytest.mark.parametrize("data", [b"GET / HTTP/1.1\r\nno field\r\n\r\n", b"nothing\r\n", b"GET / HTTP/3.0\r\n\r\n"])
def test_what_is_no_request_is_refused(data: bytes) -> None:
    with pytest.raises(HeadError):
        Handler().reader.feed(data)
