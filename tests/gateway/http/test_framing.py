"""Requests whose version or framing is refused (RFC 9110, 15.6.6; RFC 9112, 6.1)."""

import pytest
from starlette.responses import Response

from serving import connect, serving

pytestmark = pytest.mark.virtual
_BOTH = "POST / HTTP/1.1\r\nHost: test\r\nContent-Length: 5\r\nTransfer-Encoding: chunked\r\n\r\n0\r\n\r\n"
_REORDERED = "POST / HTTP/1.1\r\nHost: test\r\ntransfer-encoding: Chunked\r\nContent-Length: 0\r\n\r\n0\r\n\r\n"
_OLD = "POST / HTTP/1.0\r\nHost: test\r\nTransfer-Encoding: chunked\r\n\r\n0\r\n\r\n"


@pytest.mark.parametrize(
    ("request_text", "status"),
    [
        (_BOTH, b"400"),
        (_REORDERED, b"400"),
        (_OLD, b"400"),
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
