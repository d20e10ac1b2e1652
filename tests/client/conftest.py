"""A different server with the same vocabularies: other addresses and nesting, more types, fewer predicates."""

import contextlib
import threading
from collections.abc import Iterator
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from socketserver import StreamRequestHandler, ThreadingTCPServer

import pytest

PREFIXES = """
@prefix dcterms: <http://purl.org/dc/terms/> .
@prefix ex: <https://example.org/ns#> .
@prefix http: <http://www.w3.org/2011/http#> .
@prefix hybrit: <https://hybr-it-projekt.de/ns/hybr-it#> .
@prefix ldp: <http://www.w3.org/ns/ldp#> .
@prefix lf: <https://w3id.org/linked-fleet#> .
@prefix prov: <http://www.w3.org/ns/prov#> .
@prefix qudt: <http://qudt.org/schema/qudt/> .
@prefix rdfs: <http://www.w3.org/2000/01/rdf-schema#> .
@prefix sh: <http://www.w3.org/ns/shacl#> .
@prefix sosa: <http://www.w3.org/ns/sosa/> .
@prefix unit: <http://qudt.org/vocab/unit/> .
@prefix vom: <http://vocab.arvida.de/2015/06/vom/vocab#> .
@prefix xsd: <http://www.w3.org/2001/XMLSchema#> .
"""

PAGES = {
    # the parts of the cell are only named in its Link field
    "/start": '<> a ex:Site, hybrit:RoboticThing ; rdfs:label "Hall 7" ; ldp:contains </n/old> .',
    "/n/4711": '<> a ex:Cell, hybrit:RoboticThing, ex:Fenced ; dcterms:identifier "cell" ; ex:fence true .',
    "/n/8c1": """<> a ex:Arm, hybrit:RoboticThing, <https://schema.org/Product> ; dcterms:identifier "lefty" ;
        dcterms:title "The left arm" ; dcterms:hasPart </q?id=9>, </things#gripper> ;
        hybrit:action </do/rest>, </do/3> .
        </q?id=9> dcterms:title "Elbow" .""",
    "/q?id=9": """<> a ex:Hinge, hybrit:RoboticThing ; dcterms:title "Elbow" ; dcterms:isPartOf </n/8c1> ;
        ex:angle </v/aa1> ; hybrit:property </v/odd>, </v/unk> ; hybrit:action </do/77f> .
        </v/aa1> a hybrit:Property .""",
    "/things": '<#gripper> a ex:Gripper, hybrit:RoboticThing ; dcterms:title "Two fingers" . <#other> a ex:Other .',
    "/v/aa1": """<> a hybrit:Property, ex:Angle ; sosa:resultTime "2026-11-21T10:00:00Z"^^xsd:dateTime ;
        ex:measured [ vom:numericalValue "12.5"^^xsd:double ; qudt:unit unit:DEG ] .""",
    "/v/odd": '<> a hybrit:Property, ex:Mood ; dcterms:title "mood" ; ex:colour "blue" ; ex:maker </n/8c1> .',
    "/v/unk": """<> a hybrit:Property ; dcterms:title "load" ;
        lf:value [ vom:numericalValue lf:unknown ; vom:unit unit:N ] .""",
    "/do/77f": """<> a hybrit:Action ; dcterms:title "Bend" ; hybrit:consumes </shapes/bend#in> ; hybrit:binding
        [ http:methodName "PUT" ; http:requestURI "URL/run/here"^^xsd:anyURI ], [ http:methodName "GET" ] .""",
    "/shapes/bend": """<#in> a sh:NodeShape ; sh:class ex:Bending ;
        sh:property [ sh:path ex:goal ; sh:name "goal" ; sh:minCount 1 ; sh:maxCount 2 ; sh:node </shapes/goal#one> ],
            [ sh:path ex:mode ; sh:in ( "soft" "hard" ) ; sh:minCount 1 ; sh:maxCount 1 ; sh:defaultValue "soft" ],
            [ sh:path ex:tries ; sh:datatype xsd:integer ; sh:maxCount 1 ; sh:minInclusive 1 ; sh:maxExclusive 4 ] .""",
    "/shapes/goal": """<#one> a sh:NodeShape ;
        sh:property [ sh:path ex:axis ; sh:name "axis" ; sh:minCount 1 ; sh:maxCount 1 ; sh:nodeKind sh:IRI ],
            [ sh:path vom:numericalValue ; sh:name "value" ; sh:minCount 1 ; sh:maxCount 1 ; sh:datatype xsd:float ],
            [ sh:path vom:unit ; sh:name "unit" ; sh:minCount 1 ; sh:maxCount 1 ] ;
        sh:or ( [ sh:property [ sh:path ex:axis ; sh:hasValue </q?id=9> ], [ sh:path vom:unit ; sh:in ( unit:DEG ) ],
                    [ sh:path vom:numericalValue ; sh:minInclusive -10 ; sh:maxExclusive 90 ] ]
                [ sh:property [ sh:path ex:axis ; sh:hasValue </q?id=9> ], [ sh:path vom:unit ; sh:in ( unit:RAD ) ],
                    [ sh:path vom:numericalValue ; sh:minInclusive -0.17 ; sh:maxExclusive 1.57 ] ]
                [ sh:property [ sh:path ex:axis ; sh:hasValue </things#gripper> ],
                    [ sh:path vom:unit ; sh:hasValue unit:MilliM ],
                    [ sh:path vom:numericalValue ; sh:minInclusive 0 ; sh:maxInclusive 40 ] ] ) .""",
    # neither shape nor binding: OPTIONS says the method
    "/do/rest": '<> a hybrit:Action ; rdfs:label "Rest" .',
    "/do/3": """<> a hybrit:Action ; rdfs:label "Break" ;
        hybrit:binding [ http:mthd ex:POST ; http:requestURI </run/no> ] ; rdfs:comment "It cannot be repaired." .""",
    # invocations without an action that cancels them
    "/runs/1": "<> a prov:Activity, hybrit:Invocation ; lf:state lf:running .",
    "/runs/2": """<> a prov:Activity, hybrit:Invocation ; lf:state lf:succeeded ;
        prov:endedAtTime "2026-11-21T10:00:05Z"^^xsd:dateTime .""",
}  # fmt: skip
REFUSAL = b'{"title": "No", "status": 409, "detail": "it is broken", "report": [{"path": "x#a", "message": "m"}]}'
JOB = "<> a prov:Activity, ex:Job ; lf:state lf:{state} ; lf:progress {progress} ; hybrit:action <{url}/stop> ."


@dataclass
class OtherTree:
    """``requests``: (method, path, body) as received; a job advances whenever it is read."""

    url: str = ""
    requests: list[tuple[str, str, bytes]] = field(default_factory=list)
    headers: list[dict[str, str]] = field(default_factory=list)
    looks: dict[str, int] = field(default_factory=dict)
    stopped: set[str] = field(default_factory=set)
    endless: bool = False
    lock: threading.Lock = field(default_factory=threading.Lock)

    @property
    def root(self) -> str:
        return f"{self.url}/start"

    def sent(self, method: str) -> list[tuple[str, bytes]]:
        return [(path, body) for each, path, body in self.requests if each == method]

    def new_job(self) -> str:
        with self.lock:
            path = f"/jobs/{len(self.looks)}"
            self.looks[path] = 0
        return path

    def job(self, path: str) -> str:
        with self.lock:
            self.looks[path] += 1
            looks = self.looks[path]
        if path in self.stopped:
            return JOB.format(state="cancelled", progress=0.5, url=path)
        over = looks > 2 and not self.endless
        return JOB.format(state="succeeded" if over else "running", progress=1 if over else 0.5, url=path)


class Handler(BaseHTTPRequestHandler):
    protocol_version = "HTTP/1.1"
    disable_nagle_algorithm = True
    tree: OtherTree

    def do_GET(self) -> None:
        self._note()
        if self.path == "/n/old":
            self._answer(301, b"", location="/n/4711")
        elif self.path in self.tree.looks:
            self._turtle(self.tree.job(self.path))
        elif self.path.endswith("/stop"):
            self._turtle("<> a hybrit:Action ; hybrit:binding [ http:mthd ex:POST ; http:requestURI <> ] .")
        elif self.path in PAGES:
            self._turtle(PAGES[self.path].replace("URL", self.tree.url))
        else:
            self._answer(404, b"nothing here", content_type="text/plain")

    def do_OPTIONS(self) -> None:
        self._note()
        self._answer(204, b"", allow="GET, OPTIONS, POST")

    def do_POST(self) -> None:
        body = self._note()
        if self.path.endswith("/stop"):
            self.tree.stopped.add(self.path.removesuffix("/stop"))
            self._answer(204, b"")
        elif self.path == "/run/no":
            self._answer(409, REFUSAL, content_type="application/problem+json")
        elif self.path == "/do/rest" and not body:
            self._answer(204, b"")
        else:
            self._answer(202, b"", location=self.tree.new_job())

    do_PUT = do_POST  # noqa: N815

    def do_DELETE(self) -> None:
        self._note()
        self._answer(204, b"")

    def _note(self) -> bytes:
        body = self.rfile.read(int(self.headers.get("content-length", 0)))
        self.tree.requests.append((self.command, self.path, body))
        self.tree.headers.append({name.lower(): value for name, value in self.headers.items()})
        return body

    def _turtle(self, text: str) -> None:
        etag = f'"{hash(text)}"'
        related = {"link": '</n/8c1>; rel="related", </start>; rel="up"'} if self.path == "/n/4711" else {}
        if self.headers.get("if-none-match") == etag:
            self._answer(304, b"", etag=etag)
        else:
            self._answer(200, (PREFIXES + text).encode(), content_type="text/turtle", etag=etag, **related)

    def _answer(self, status: int, body: bytes, **fields: str) -> None:
        self.send_response(status)
        for name, value in fields.items():
            self.send_header(name.replace("_", "-"), value)
        if status not in (204, 304):
            self.send_header("content-length", str(len(body)))
        self.end_headers()
        self.wfile.write(body)

    def log_message(self, *_: object) -> None:
        """Log nothing."""


@pytest.fixture
def other_tree() -> Iterator[OtherTree]:
    tree = OtherTree()
    handler = type("OwnHandler", (Handler,), {"tree": tree})
    with ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        tree.url = f"http://127.0.0.1:{server.server_address[1]}"
        thread = threading.Thread(target=server.serve_forever, args=(0.01,), daemon=True)
        thread.start()
        yield tree
        server.shutdown()
        thread.join()


@dataclass
class Script:
    """A scripted server: a list of raw responses for each path, of which the last is repeated."""

    answers: dict[str, list[bytes]] = field(default_factory=dict)
    asked: list[tuple[str, str, dict[str, str]]] = field(default_factory=list)
    url: str = ""

    def at(self, path: str) -> list[dict[str, str]]:
        """Return the header fields of each request for ``path``."""
        return [fields for _, asked, fields in self.asked if asked == path]


class ScriptHandler(StreamRequestHandler):
    script: Script

    def handle(self) -> None:
        head = b"".join(iter(self.rfile.readline, b"\r\n")).decode()
        (request, *lines) = head.splitlines() or [""]
        method, path = [*request.split(), "", ""][:2]
        fields = {name.strip().lower(): value.strip() for name, _, value in (line.partition(":") for line in lines)}
        self.rfile.read(int(fields.get("content-length", 0)))
        self.script.asked.append((method, path, fields))
        left = self.script.answers.get(path, [b"HTTP/1.1 404 Not Found\r\ncontent-length: 0\r\n\r\n"])
        answer = left.pop(0) if len(left) > 1 else left[0]
        with contextlib.suppress(BrokenPipeError, ConnectionResetError):  # the client may have disconnected
            self.wfile.write(answer)


@pytest.fixture
def script() -> Iterator[Script]:
    said = Script()
    with ThreadingTCPServer(("127.0.0.1", 0), type("OwnReciter", (ScriptHandler,), {"script": said})) as server:
        said.url = f"http://127.0.0.1:{server.server_address[1]}"
        thread = threading.Thread(target=server.serve_forever, args=(0.01,), daemon=True)
        thread.start()
        yield said
        server.shutdown()
        thread.join()
