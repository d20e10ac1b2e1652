"""A client of the fleet: https, event streams and WebSockets through the front, whose name needs no DNS entry."""

import contextlib
import http.client
import json
import socket
import ssl
import subprocess
import tempfile
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import urlsplit

from rdflib import Graph, URIRef
from websockets.sync.client import ClientConnection, connect

HERE = "127.0.0.1"
TURTLE = "text/turtle"
_TIMEOUT_S = 30.0


class TruncatedResponseError(http.client.HTTPException):
    """The connection ended in the middle of a response body."""


@dataclass(frozen=True)
class Response:
    """The response to one request; ``body`` unchanged."""

    status: int
    fields: Mapping[str, str]
    body: bytes

    def graph(self, base: str) -> Graph:
        return Graph().parse(data=self.body, format=self.fields["content-type"].partition(";")[0], publicID=base)


class Front:
    """A client of the front that trusts only the certificate ``authority``, given as PEM text.

    ``token`` identifies it if that is set, in requests without a cookie.
    """

    def __init__(self, domain: str, port: int, authority: str) -> None:
        self.domain, self.port = domain, port
        self.root = f"https://{domain}:{port}/"
        self.token = ""
        self._authority = authority
        self._tls = ssl.create_default_context(cadata=authority)

    def request(
        self, iri: str, method: str = "GET", body: str | None = None, timeout_s: float = _TIMEOUT_S, **fields: str
    ) -> Response:
        """Send one request on a connection of its own; ``Content_Type`` stands for Content-Type.

        Raises TruncatedResponseError.
        """
        with contextlib.closing(_Connection(self.domain, self.port, timeout_s, self._tls)) as connection:
            connection.request(method, self._target(iri), body, self._fields(fields))
            answer = connection.getresponse()
            return Response(answer.status, {k.lower(): v for k, v in answer.getheaders()}, _body(answer))

    def graph(self, iri: str) -> Graph:
        """Return the description of a resource; AssertionError if it does not exist."""
        answer = self.request(iri, Accept="application/n-triples")
        assert answer.status == http.client.OK, f"GET {iri} answered {answer.status}: {answer.body[:300]!r}"
        return answer.graph(iri)

    def follow_link(self, iri: str, predicate: str, ending: str) -> str:
        """Return the only link by ``predicate`` whose IRI ends with ``ending``."""
        found = [str(o) for o in self.graph(iri).objects(None, URIRef(predicate)) if str(o).endswith(ending)]
        assert found, f"{iri} has no {predicate} that ends in {ending}"
        return found[0]

    @contextlib.contextmanager
    def open_event_stream(self, iri: str) -> Iterator[Iterator[str]]:
        """Yield the data of each event of an event stream."""
        with contextlib.closing(_Connection(self.domain, self.port, _TIMEOUT_S, self._tls)) as connection:
            connection.request("GET", self._target(iri), headers=self._fields({"Accept": "text/event-stream"}))
            answer = connection.getresponse()
            assert answer.status == http.client.OK, f"the event stream answered {answer.status}"
            yield _events(answer)

    @contextlib.contextmanager
    def open_websocket(self, iri: str) -> Iterator[ClientConnection]:
        tcp = socket.create_connection((HERE, self.port), _TIMEOUT_S)
        url = f"wss://{self.domain}:{self.port}{self._target(iri)}"
        with connect(url, sock=tcp, ssl=self._tls, server_hostname=self.domain, open_timeout=_TIMEOUT_S) as websocket:
            yield websocket

    def http_version(self) -> str:
        """Return the HTTP version on which curl and the front agree when curl offers HTTP/2."""
        with tempfile.TemporaryDirectory() as folder:
            authority = Path(folder, "ca.pem")
            authority.write_text(self._authority)
            done = subprocess.run(  # noqa: S603
                ["curl", "-sS", "--noproxy", "*", "--http2", "--cacert", str(authority), "-o", "/dev/null",  # noqa: S607
                 "--resolve", f"{self.domain}:{self.port}:{HERE}", "-w", "%{http_version} %{http_code}", self.root],
                capture_output=True, text=True, timeout=_TIMEOUT_S, check=False,
            )  # fmt: skip
        assert done.returncode == 0, done.stderr
        return done.stdout

    def supports_quic(self) -> bool:
        """Return True if QUIC responds: to an unknown version, it lists its own ones (RFC 8999, 6)."""
        packet = bytes([0xC0]) + b"\x1a\x2a\x3a\x4a" + bytes([8]) + b"linkedfl" + bytes([8]) + b"eetcheck"
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as udp:
            udp.settimeout(5)
            udp.sendto(packet.ljust(1200, b"\0"), (HERE, self.port))
            with contextlib.suppress(TimeoutError):
                answer = udp.recv(2048)
                return bool(answer[0] & 0x80) and answer[1:5] == bytes(4)
        return False

    def _fields(self, fields: Mapping[str, str]) -> dict[str, str]:
        proof = {"Authorization": f"Bearer {self.token}"} if self.token and "Cookie" not in fields else {}
        return {"Host": f"{self.domain}:{self.port}", **proof, **{k.replace("_", "-"): v for k, v in fields.items()}}

    def _target(self, iri: str) -> str:
        parts = urlsplit(iri)
        assert (parts.hostname or self.domain) == self.domain, f"{iri} leads out of the fleet"
        return (parts.path or "/") + (f"?{parts.query}" if parts.query else "")


class _Connection(http.client.HTTPSConnection):
    """A connection to the front on this machine, by the name in its certificate."""

    def __init__(self, domain: str, port: int, timeout_s: float, tls: ssl.SSLContext) -> None:
        super().__init__(domain, port, timeout=timeout_s, context=tls)
        self._own_tls = tls

    def connect(self) -> None:
        tcp = socket.create_connection((HERE, self.port), self.timeout)
        self.sock = self._own_tls.wrap_socket(tcp, server_hostname=self.host)


def _body(answer: http.client.HTTPResponse) -> bytes:
    try:
        return answer.read()
    except (http.client.IncompleteRead, ConnectionError, ssl.SSLError) as error:
        raise TruncatedResponseError(repr(error)) from error


def _events(answer: http.client.HTTPResponse) -> Iterator[str]:
    data: list[str] = []
    while line := answer.readline():
        text = line.decode().rstrip("\n")
        if text.startswith("data:"):
            data.append(text[5:].removeprefix(" "))
        elif not text and data:
            yield "\n".join(data)
            data = []


def read_deliveries(port: int) -> list[dict[str, str]]:
    """Return the deliveries that the receiver has accepted so far."""
    with contextlib.closing(http.client.HTTPConnection(HERE, port, timeout=5)) as connection:
        connection.request("GET", "/")
        return json.loads(connection.getresponse().read())  # type: ignore[no-any-return]
