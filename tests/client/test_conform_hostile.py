"""The conformance checker with hostile servers: it ends with results, stays on the server, and deletes nothing."""

import asyncio
import contextlib
import json
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from linked_fleet_client.conform import command
from linked_fleet_client.conform.web import MAX_BODY_BYTES, Web
from running import free_port
from virtual.loop import current
from virtual.tcp import Listener

pytestmark = pytest.mark.virtual
Reply = Callable[[str, str], bytes]
TYPE = "Content-Type: text/turtle\r\n"
HYBRIT = """@prefix hybrit: <https://hybr-it-projekt.de/ns/hybr-it#> . @prefix ldp: <http://www.w3.org/ns/ldp#> .
@prefix sh: <http://www.w3.org/ns/shacl#> ."""


def http(status: str, headers: str = "", body: str = "") -> bytes:
    content, headers = body.encode(), f"{headers}Connection: close\r\n"
    return f"HTTP/1.1 {status}\r\n{headers}Content-Length: {len(content)}\r\n\r\n".encode() + content


class Hostile:
    """Answers each connection once with ``reply(method, path)`` and closes it, unless it ``stalls``.

    If it ``keeps`` a connection, it closes it at the next request.
    """

    def __init__(self, reply: Reply, stalls: bool, keeps: bool) -> None:
        self.reply, self.stalls, self.keeps = reply, stalls, keeps
        self.lines: list[str] = []
        loop = current()
        assert loop is not None
        self.listener = Listener(loop.internet)
        self.listener.begin(lambda: _Conversation(self))
        self.root = f"http://127.0.0.1:{self.listener.port}/"


class _Conversation(asyncio.Protocol):
    def __init__(self, server: Hostile) -> None:
        self.server, self.head = server, b""

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        assert isinstance(transport, asyncio.Transport)
        self.transport = transport

    def data_received(self, data: bytes) -> None:
        before, self.head = self.head, self.head + data
        if b"\r\n\r\n" in before and self.server.keeps:
            self.transport.close()
        if b"\r\n\r\n" in before or b"\r\n\r\n" not in self.head:
            return
        line = self.head.decode("latin-1").partition("\r\n")[0]
        self.server.lines.append(line)
        method, path, *_ = line.split(" ")
        self.transport.write(self.server.reply("WEBSOCKET" if b"Upgrade: websocket" in self.head else method, path))
        if not self.server.stalls and not self.server.keeps:
            self.transport.close()


@contextlib.contextmanager
def hostile(reply: Reply, stalls: bool = False, keeps: bool = False) -> Iterator[Hostile]:
    server = Hostile(reply, stalls, keeps)
    with contextlib.closing(server.listener):
        yield server


def results(root: str, capsys: pytest.CaptureFixture[str], *options: str) -> dict[str, str]:
    """Return outcomes by requirement, of a check that found a violated "must"."""
    assert command([root, "--json", "--timeout", "30", "--limit", "120", *options]) == 1
    found = json.loads(capsys.readouterr().out)["results"]
    assert len(found) == 29
    assert all(result["evidence"].isprintable() and len(result["evidence"]) <= 240 for result in found)
    return {result["id"]: result["outcome"] for result in found}


NASTY: dict[str, Reply] = {
    "no HTTP": lambda method, path: b"\x00\xff" * 500 + b"\r\n\r\n",
    "nothing": lambda method, path: b"",
    "endless redirects": lambda method, path: http("302 Found", f"Location: {path}x\r\n"),
    "redirect to itself": lambda method, path: http("301 Moved", "Location: /\r\n"),
    "redirect to no URL": lambda method, path: http("302 Found", "Location: http://[::1\r\n"),
    "huge head": lambda method, path: b"HTTP/1.1 200 OK\r\nX: " + b"x" * 10**6 + b"\r\n\r\n",
    "many fields": lambda method, path: http("200 OK", TYPE + "Link: <a>; rel=related\r\n" * 5000),
    "huge body": lambda method, path: http("200 OK", TYPE, "#" * (MAX_BODY_BYTES + 1)),
    "wrong length": lambda method, path: b"HTTP/1.1 200 OK\r\nContent-Length: 99\r\n\r\nx",
    "garbage": lambda method, path: http("200 OK", TYPE, "<> a [ [ ) \x1b[2J \x00 ."),
    "deep": lambda method, path: http("200 OK", TYPE, "<> <p> " + "[ <p> " * 20000),
    "no UTF-8": lambda method, path: (
        b"HTTP/1.1 200 OK\r\nContent-Type: text/turtle\r\nContent-Length: 2\r\n\r\n\xff\xfe"
    ),
    "control characters": lambda method, path: b"HTTP/1.1 200 OK\r\nETag: \xe9\x9b\r\nContent-Length: 0\r\n\r\n",
    "bomb": lambda method, path: http("200 OK", TYPE + "Content-Encoding: gzip\r\n", "x"),
    "every number": lambda method, path: http(
        "200 OK", TYPE, '<> <p> "1e999999999"^^<http://www.w3.org/2001/XMLSchema#decimal> .'
    ),
    "foul link set": lambda method, path: http(
        "200 OK", 'Content-Type: application/linkset+json\r\nLink: </>; rel="linkset"\r\n', '{"linkset": [[], 3, "x"]}'
    ),
    "foul links": lambda method, path: http("200 OK", TYPE + 'Link: <http://[>; rel="related", <>;;rel, <%\r\n', ""),
}


@pytest.mark.parametrize("name", NASTY)
def test_any_response_yields_results(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    with hostile(NASTY[name]) as server:
        found = results(server.root, capsys)
    assert "failed" in {found["R0.1"], found["R1.2"]}
    assert found["R0.12"] == "failed"


def test_endless_responses_are_cut_at_the_time_limit(capsys: pytest.CaptureFixture[str]) -> None:
    """Each endless body costs the time limit of one request, and all of them at most the total limit."""
    with hostile(lambda method, path: b"HTTP/1.1 200 OK\r\nContent-Length: 9\r\n\r\n", stalls=True) as server:
        found = results(server.root, capsys, "--timeout", "1", "--limit", "2")
    assert found["R0.4"] == "failed"
    assert "cantTell" in found.values()


def test_endless_trees_end(capsys: pytest.CaptureFixture[str]) -> None:
    """A tree in which everything has ten more parts is walked no further than requested."""

    def reply(method: str, path: str) -> bytes:
        parts = " ".join(f"<> hybrit:property <{path}{number}> ." for number in range(10))
        return http("200 OK", TYPE, f"{HYBRIT} <> a hybrit:RoboticThing . {parts}")

    with hostile(reply) as server:
        results(server.root, capsys, "--resources", "12")
        assert len({line for line in server.lines if line.startswith("GET ")}) <= 13


def test_no_link_or_redirect_leads_to_another_server(capsys: pytest.CaptureFixture[str]) -> None:
    """Neither a link, a Link field, a redirect, a Location, nor the redirect of a WebSocket leads away."""
    with hostile(lambda method, path: http("200 OK")) as elsewhere:

        def reply(method: str, path: str) -> bytes:
            if path == "/away":
                return http("302 Found", f"Location: {elsewhere.root}\r\n")
            if method == "WEBSOCKET":
                return http("302 Found", f"Location: {elsewhere.root.replace('http', 'ws')}\r\n")
            away = f'Link: <{elsewhere.root}>; rel="related"\r\nLocation: {elsewhere.root}\r\n'
            names = f"hybrit:property <{elsewhere.root}p>, </away> ; hybrit:blueprint <{elsewhere.root}b>"
            text = f"{HYBRIT} <> a hybrit:RoboticThing ; hybrit:subscriptions <> ; {names} ."
            return http("201 Created" if method == "POST" else "200 OK", TYPE + away + "Allow: GET, POST\r\n", text)

        with hostile(reply) as server:
            results(server.root, capsys)
            results(server.root + "away", capsys)
        assert elsewhere.lines == []


@pytest.mark.parametrize("listed", ["", "<> ldp:contains </robot> ."])
@pytest.mark.parametrize("known", ["/robot", "/other"])
def test_only_own_subscriptions_are_deleted(known: str, listed: str, capsys: pytest.CaptureFixture[str]) -> None:
    """A server may name its robot as the new subscription: no robot is deleted, whether already known or not."""
    posted: list[str] = []

    def reply(method: str, path: str) -> bytes:
        posted.extend([path] if method == "POST" else [])
        text = f"{HYBRIT} <> a hybrit:RoboticThing ; hybrit:subscriptions </s> ; hybrit:property <{known}> ."
        text = f"{HYBRIT} <> a ldp:Container . {listed if posted else ''}" if path == "/s" else text
        headers = TYPE + "Allow: GET, POST, DELETE\r\n" + ("Location: /robot\r\n" if method == "POST" else "")
        return http("201 Created" if method == "POST" else "200 OK", headers, text if method == "GET" else "")

    with hostile(reply) as server:
        found = results(server.root, capsys)
        assert posted
        deleted = [line for line in server.lines if line.startswith("DELETE")]
    if known == "/robot" or not listed:
        assert not deleted
        assert found["R0.8"] == "failed"


def test_shapes_with_programs_are_not_run(capsys: pytest.CaptureFixture[str]) -> None:
    """SPARQL in a blueprint could fetch from anywhere or never end: it is never run."""

    def reply(method: str, path: str) -> bytes:
        violated = "SELECT $this WHERE { $this a ?anything }"
        shape = f'<#s> a sh:NodeShape ; sh:targetNode </> ; sh:sparql [ sh:select "{violated}" ] .'
        thing = "<> a hybrit:RoboticThing ; hybrit:blueprint </b> ."
        return http("200 OK", TYPE, f"{HYBRIT} {shape if path == '/b' else thing}")

    with hostile(reply) as server:
        assert results(server.root, capsys)["R1.11"] == "cantTell"


def test_an_absent_server_is_unreachable(capsys: pytest.CaptureFixture[str]) -> None:
    assert command([f"http://127.0.0.1:{free_port()}/"]) == 3
    assert "cannot be reached" in capsys.readouterr().err


@pytest.mark.parametrize("url", ["ftp://127.0.0.1/", "127.0.0.1", "http://user@127.0.0.1/", "http://[::1/", "http://"])
def test_an_invalid_url_is_a_usage_error(url: str) -> None:
    with pytest.raises(SystemExit) as ended:
        command([url])
    assert ended.value.code == 2


def test_results_that_cannot_be_written_are_still_printed(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    with hostile(NASTY["nothing"]) as server, pytest.raises(SystemExit) as ended:
        command([server.root, "--earl", str(tmp_path / "missing" / "earl.ttl")])
    assert ended.value.code == 2
    assert "R1.12" in capsys.readouterr().out


async def test_a_connection_that_is_closed_between_requests_is_no_fault() -> None:
    with hostile(lambda method, path: b"HTTP/1.1 200 OK\r\nContent-Length: 0\r\n\r\n", keeps=True) as server:
        async with Web(server.root, 5, 30) as web:
            answers = [await web.request("GET", server.root) for _ in range(3)]
        assert [answer.status for answer in answers] == [200] * 3
