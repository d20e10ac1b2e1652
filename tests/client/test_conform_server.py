"""The conformance checker, with a small correct server that other tests break."""

import argparse
import asyncio
import base64
import contextlib
import hashlib
import http.client
import struct
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler
from urllib.parse import urlsplit

import pytest
import rdflib

from linked_fleet_client.conform.main import conform
from linked_fleet_client.conform.report import Report
from linked_fleet_client.conform.verdict import Outcome
from virtual.handlers import handling
from virtual.loop import current

pytestmark = pytest.mark.virtual
PREFIXES = """\
@prefix dcterms: <http://purl.org/dc/terms/> . @prefix ex: <http://example.org/own#> .
@prefix hybrit: <https://hybr-it-projekt.de/ns/hybr-it#> . @prefix ldp: <http://www.w3.org/ns/ldp#> .
@prefix sh: <http://www.w3.org/ns/shacl#> . @prefix vom: <http://vocab.arvida.de/2015/06/vom/vocab#> .
"""
THING = """<> a hybrit:RoboticThing, ldp:RDFSource ; dcterms:title "arm" ; hybrit:subscriptions </s/2> ;
 hybrit:property </p/1> ; hybrit:action </a/1> ."""
PAGES = {
    "/": """<> a hybrit:RoboticThing, ldp:Container ; dcterms:title "all" ;
 hybrit:subscriptions </s/1> ; ldp:contains </t> .""",
    "/t": THING,
    "/p/1": "<> a hybrit:Property ; vom:numericalValue 1.5 .",
    "/a/1": """<> a hybrit:Action ; hybrit:consumes [ a sh:NodeShape ;
 sh:property [ sh:path vom:numericalValue ; sh:minCount 1 ] ] .""",
    "/s/1": "<> a ldp:Container, ldp:BasicContainer .",
    "/s/2": "<> a ldp:Container, ldp:BasicContainer .",
}
BLUEPRINT = """<#shape> a sh:NodeShape ; sh:targetClass hybrit:RoboticThing ;
 sh:property [ sh:path dcterms:title ; sh:minCount 1 ] ."""
RELATED = {"/": ("/s/1",), "/t": ("/s/2", "/p/1", "/a/1", "/b")}


def replaced(path: str, old: str, new: str) -> dict[str, str]:
    assert old in PAGES[path]
    return {path: PAGES[path].replace(old, new)}


class Server:
    """``flaws``: names of its faults; ``pages``: replaced contents."""

    def __init__(self, flaws: set[str], pages: dict[str, str]) -> None:
        loop = current()
        assert loop is not None
        self.listener = handling(loop, Handler, self)
        self.flaws = flaws
        self.pages = {**PAGES, **pages}
        self.subscriptions: dict[str, tuple[str, str]] = {}
        self.count = 0
        self.bodies: list[str] = []
        self.root = f"http://127.0.0.1:{self.listener.port}/"

    def subscribe(self, callback: str, media_type: str) -> str:
        self.count += 1
        path = f"/s/2/{self.count}"
        self.subscriptions[path] = (callback, media_type)
        return path


class Handler(BaseHTTPRequestHandler):
    server: Server  # type: ignore[assignment]
    disable_nagle_algorithm = True
    wbufsize = -1  # head and body leave in one segment

    def setup(self) -> None:
        self.protocol_version = "HTTP/1.0" if "http-1.0" in self.server.flaws else "HTTP/1.1"
        super().setup()

    def log_message(self, format: str, *args: object) -> None:
        """Log nothing."""

    def has(self, *flaws: str) -> bool:
        return bool(self.server.flaws.intersection(flaws))

    def reply(self, status: int, body: bytes = b"", **headers: str) -> None:
        self.send_response(status)
        for name, value in headers.items():
            self.send_header(name.replace("_", "-"), value)
        if status not in (204, 304):
            self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        if self.command != "HEAD" or self.has("head-with-body"):
            self.wfile.write(body if status not in (204, 304) else b"")

    def body(self) -> str:
        return self.rfile.read(int(self.headers.get("Content-Length", 0))).decode()

    def graph(self) -> rdflib.Graph | None:
        text = self.server.pages.get(self.path)
        if self.path in self.server.subscriptions:
            text = f'<> a hybrit:Subscription ; hybrit:callbackURL "{self.server.subscriptions[self.path][0]}" .'
        if text is None:
            return None
        members = "".join(f"<> ldp:contains <{path}> ." for path in self.server.subscriptions if self.path == "/s/2")
        return rdflib.Graph().parse(data=PREFIXES + text + members, publicID=self.server.root + self.path[1:])

    def render(self, accept: str) -> tuple[bytes, str]:
        if "ld+json" in accept:
            return self.graph().serialize(format="json-ld").encode(), "application/ld+json"
        return self.graph().serialize(format="turtle").encode(), "text/turtle"

    def allow(self) -> str:
        writes = {"/a/1": ", POST, PUT", "/s/1": ", POST", "/s/2": ", POST"}
        allow = "GET, HEAD, OPTIONS" + writes.get(
            self.path, ", DELETE" if self.path in self.server.subscriptions else ""
        )
        return allow.replace(", PUT", "") if self.has("no-put") else allow

    def do_OPTIONS(self) -> None:
        if self.has("no-options"):
            return self.reply(405)
        return self.reply(204, **({} if self.has("no-allow") else {"Allow": self.allow()}))

    def do_GET(self) -> None:
        if "Host" not in self.headers and not self.has("no-host"):
            return self.reply(400)
        if self.headers.get("Upgrade") == "websocket" and not self.has("no-websocket", "no-upgrade"):
            return self.websocket()
        if self.headers.get("Upgrade") == "callback" and not self.has("no-callback", "no-upgrade"):
            return self.callback()
        if self.path == "/" and self.has("root-500"):
            return self.reply(500)
        if self.path == "/p/1" and self.has("property-405"):
            return self.reply(405)
        if self.graph() is None:
            return self.reply(404)
        return self.represent()

    do_HEAD = do_GET  # noqa: N815

    def represent(self) -> None:
        accept = self.headers.get("Accept", "")
        content, media_type = self.render(accept)
        if self.path == "/t" and self.has("html") and "turtle" not in accept:
            content, media_type = b"<p>", "text/html"
        if self.path == "/t" and self.has("garbage"):
            content = b"<> a [ [ ; } ."
        tag = '"' + hashlib.sha256(content).hexdigest()[:16] + '"'
        if self.headers.get("If-None-Match") == tag and not self.has("no-304"):
            return self.reply(304, ETag=tag)
        related = (
            []
            if self.has("no-link")
            else [url for url in RELATED.get(self.path, ()) if url != "/b" or "/b" in self.server.pages]
        )
        related = related[:1] if self.has("some-links") else related
        headers = {"Content-Type": media_type, "ETag": tag.strip('"') if self.has("bare-etag") else tag}
        headers |= {"Link": ", ".join(f'<{url}>; rel="related"' for url in related)} if related else {}
        if self.has("no-etag") or (self.has("no-head-etag") and self.command == "HEAD"):
            del headers["ETag"]
        return self.reply(200, content, **headers)

    def callback(self) -> None:
        url, accept = self.headers.get("Callback", ""), self.headers.get("Accept", "")
        if not url and not self.has("any-callback"):
            return self.reply(400)
        self.create(url, "" if self.has("no-negotiation") else accept, 201)
        return None

    def create(self, url: str, accept: str, status: int) -> None:
        path = self.server.subscribe(url, accept)
        self.reply(status, **({} if self.has("no-location") else {"Location": path}))
        self.wfile.flush()
        if url:
            content, media_type = self.render(accept)
            self.deliver(url, content, media_type)

    def deliver(self, url: str, content: bytes, media_type: str) -> None:
        parts = urlsplit(url)
        with contextlib.closing(http.client.HTTPConnection(parts.hostname, parts.port)) as receiver:
            receiver.request("POST", parts.path, iter([content]), {"Content-Type": media_type}, encode_chunked=True)
            receiver.getresponse().read()

    def do_POST(self) -> None:
        body = self.body()
        self.server.bodies.append(f"{self.command} {self.path}")
        if "If-Match" in self.headers and not self.has("nonsense"):
            return self.reply(412)
        if self.has("broken-500"):
            return self.reply(500)
        graph = rdflib.Graph()
        with contextlib.suppress(Exception):
            graph.parse(data=body)
        if not len(graph):
            return self.reply(204 if self.has("nonsense") else 400)
        callback = next(graph.objects(None, rdflib.URIRef("https://hybr-it-projekt.de/ns/hybr-it#callbackURL")), None)
        if callback is None:
            return self.reply(400)
        self.create(str(callback), "", 204)
        return None

    do_PUT = do_POST  # noqa: N815

    def do_DELETE(self) -> None:
        self.server.bodies.append(f"DELETE {self.path}")
        if self.server.subscriptions.pop(self.path, None) is None:
            return self.reply(404)
        return self.reply(200 if self.has("delete-200") else 204)

    def websocket(self) -> None:
        key = self.headers["Sec-WebSocket-Key"] + "258EAFA5-E914-47DA-95CA-C5AB0DC85B11"
        accept = base64.b64encode(hashlib.sha1(key.encode()).digest()).decode()
        if self.has("wrong-key"):
            accept = accept[::-1]
        self.send_response(101)
        for name, value in (("Upgrade", "websocket"), ("Connection", "Upgrade"), ("Sec-WebSocket-Accept", accept)):
            self.send_header(name, value)
        self.end_headers()
        content, _ = self.render("" if self.has("no-negotiation") else self.headers.get("Accept", ""))
        self.frame(1, content)
        while (opcode := self.take()) != 8:
            if opcode == 9 and not self.has("no-pong"):
                self.frame(10, self.last)
        self.frame(8, b"\x03\xe8")
        self.close_connection = True

    def frame(self, opcode: int, content: bytes) -> None:
        size = bytes([len(content)]) if len(content) < 126 else b"\x7e" + struct.pack(">H", len(content))
        self.wfile.write(bytes([0x80 | opcode]) + size + content)
        self.wfile.flush()

    def take(self) -> int:
        head = self.rfile.read(2)
        if len(head) < 2:
            return 8
        mask, masked = self.rfile.read(4), self.rfile.read(head[1] & 127)
        self.last = bytes(byte ^ mask[index % 4] for index, byte in enumerate(masked))
        return head[0] & 15


@contextlib.contextmanager
def serving(flaws: set[str], pages: dict[str, str]) -> Iterator[Server]:
    server = Server(flaws, pages)
    with contextlib.closing(server.listener):
        yield server


def check(root: str, no_write: bool = False, resources: int = 200) -> Report:
    options = argparse.Namespace(
        url=root, timeout=3.0, limit=60.0, resources=resources, no_write=no_write, callback_host="127.0.0.1"
    )
    return asyncio.run(conform(options))


def outcomes(report: Report, outcome: Outcome) -> set[str]:
    return {result.requirement.name for result in report.results if result.verdict.outcome is outcome}


WITH_BLUEPRINT = {"/b": BLUEPRINT, **replaced("/t", "hybrit:action", "hybrit:blueprint </b> ; hybrit:action")}


def test_sound_server_breaks_nothing() -> None:
    """Everything that can be checked from outside passes; the rest is named, and nothing stays behind."""
    with serving(set(), WITH_BLUEPRINT) as server:
        report = check(server.root)
        assert outcomes(report, Outcome.FAILED) == set()
        assert outcomes(report, Outcome.CANT_TELL) == {"R1.1"}
        assert outcomes(report, Outcome.INAPPLICABLE) == {"R0.2", "R1.4", "R1.6"}
        assert not report.violates_must
        assert not server.subscriptions
        assert len([line for line in server.bodies if line.startswith("DELETE")]) == 3


def test_without_writes_nothing_is_sent() -> None:
    """Requirements that need a write stay unchecked; no request has a body or creates a callback."""
    with serving(set(), WITH_BLUEPRINT) as server:
        report = check(server.root, no_write=True)
        assert server.bodies == []
        assert server.count == 0
        assert outcomes(report, Outcome.FAILED) == set()
        told = outcomes(report, Outcome.CANT_TELL)
        assert {"R0.5", "R0.6", "R0.7", "R0.8", "R0.13", "R0.16"} <= told
        assert "R0.15" not in told


def test_actions_are_only_sent_what_cannot_run() -> None:
    """An action without constraints could run with any body: it is not invoked."""
    free = replaced("/a/1", "sh:minCount 1", "sh:maxCount 1")
    with serving(set(), free) as server, serving(set(), {}) as demanding:
        check(server.root)
        check(demanding.root)
        assert not [line for line in server.bodies if line.endswith(" /a/1")]
        assert [line for line in demanding.bodies if line.endswith(" /a/1")] == ["POST /a/1", "PUT /a/1"]


def test_only_so_many_resources_are_visited_and_of_each_kind() -> None:
    """A hundred properties do not displace the only action."""
    many = ", ".join(f"</p/{number}>" for number in range(1, 101))
    pages = {f"/p/{number}": PAGES["/p/1"] for number in range(1, 101)}
    with serving({"no-upgrade"}, {**pages, **replaced("/t", "</p/1>", many)}) as server:
        report = check(server.root, resources=8)
        assert "only 8 resources" in report.extent
        assert {"R1.9", "R1.10"} <= outcomes(report, Outcome.PASSED)
        (actions,) = [result for result in report.results if result.requirement.name == "R1.10"]
        assert "1 of them were read" in actions.verdict.evidence


def test_other_namespace_of_the_model_is_understood() -> None:
    """The paper names no IRI for hybrit: a server with its own is judged by it."""
    pages = {path: text.replace("hybrit:", "ex:") for path, text in {**PAGES, **WITH_BLUEPRINT}.items()}
    with serving({"no-upgrade"}, pages) as server:
        report = check(server.root)
        assert {"R0.9", "R1.3", "R1.8", "R1.9", "R1.10", "R1.11"} <= outcomes(report, Outcome.PASSED)
