"""Requests to the whole tree of a real gateway; most are well framed, so that they reach the code behind the parser.

One in seven is not: torn, truncated, pipelined, with two lengths or in another protocol, on a socket of its own.
"""

import asyncio
import re
from abc import ABC, abstractmethod
from collections.abc import Iterator
from random import Random

from fuzzing import bodies, mutation
from fuzzing.fields import costly
from fuzzing.findings import Tally, random_of
from fuzzing.good import BODIES
from fuzzing.hostile import ACCEPTED, SUBSCRIPTION, random_attack
from fuzzing.living import PATIENCE_S, LiveGateway, in_batches, living

AT_ONCE = 12
_HOSTILE = 0.04
_COSTLY = 0.05
_SILENCE_S = 0.1
# Unknown transfer codings (RFC 9112, 6.1), unavailable or late parts, and other major versions (RFC 9110, 15.6.6).
_DOCUMENTED = (501, 503, 504, 505)
_STATUS = re.compile(rb"(?:^|\n)HTTP/1\.1 (\d{3}) ")
_METHODS = (
    "GET", "GET", "GET", "GET", "HEAD", "OPTIONS", "POST", "PUT", "PUT", "PUT", "DELETE", "PATCH", "TRACE", "get", "X-X"
)  # fmt: skip
_PIECES = (
    "", "/", "//", ".", "..", "%2e%2e", "%2F", "%00", "%0A", "%ff", "%C3%A9", "~", "~41", "~7E", "pose", "actions",
    "rotation",
    "subscriptions", "blueprint", "invocations", "lease", "model", "meshes", "vocabulary", "annotations", "x" * 3000,
    "*", "a b",
    "00000000-0000-4000-8000-000000000000", "health", "ready", "metrics", "context", "assets", "linkset", "<>", "{}",
    ";x=1",
)  # fmt: skip
_QUERIES = (
    "", "", "", "?", "?as=turtle", "?as=html", "?as=frame", "?as=%00", "?as=x&as=y", "?depth=properties",
    "?depth=subtree",
    "?depth=x", "?interval=0.1", "?interval=-1", "?interval=1e9", "?interval=٣", "?deadband=NaN",
    "?last-event-id=%0d%0ax",
    "?interval=1&interval=2", "?" + "&" * 500, "?%", "?=&=", "?x=" + "y" * 5000, "#f",
)  # fmt: skip
_TYPES = (
    "text/turtle", "application/ld+json", "application/n-triples", "application/rdf+xml", "text/html",
    "application/json",
    "application/linkset", "application/linkset+json", "application/problem+json", "text/event-stream", "model/stl",
    "text/*", "*/*",
    "application/vnd.linked-fleet.frame", "application/octet-stream", "application/x-jelly-rdf", "application/xml",
    "x", "", ",", ";", "*/x", "text/turtle;q=0",
    "text/turtle;q=x",
    "*/*;q=0", "text/html;q=0.5, text/turtle;q=0.50001", "text/turtle;" * 200, "a/b," * 400, 'text/turtle;x="',
    "text/turtle;charset=x",
)  # fmt: skip
_FIELDS: dict[str, tuple[str, ...]] = {
    "Accept": _TYPES,
    "Content-Type": _TYPES,
    "Prefer": (
        "return=representation", "return=minimal", "respond-async", "wait=0", "wait=0.2", "dry-run", "wait=-1",
        "wait=x", "wait=1e400",
        'return="representation"', "dry-run, return=representation", ",,,", "=", "wait=0, wait=1", "x" * 900,
    ),
    "If-None-Match": ("*", '"x"', 'W/"x"', '"', "x", '"a", "b"', ", ".join('"x"' for _ in range(300))),
    "If-Match": ("*", '"x"', 'W/"x"', '"', "x"),
    "If-Modified-Since": ("Sat, 21 Nov 2026 00:00:00 GMT", "x", "-1"),
    "Range": ("bytes=0-1", "bytes=-1", "bytes=0-0,2-3", "bytes=9-1", "x=1", "bytes=" + "0-1," * 300),
    "Upgrade": ("websocket", "callback", "h2c", "x", "callback, websocket", ""),
    "Connection": ("Upgrade", "keep-alive, Upgrade", "keep-alive", "x", ""),
    "Callback": ("<http://localhost:9/x>", "http://localhost:9/", "http://127.0.0.1:9/", "x", "http://[",
    "ftp://localhost/", ""),
    "Sec-WebSocket-Key": ("dGhlIHNhbXBsZSBub25jZQ==", "x", ""),
    "Sec-WebSocket-Version": ("13", "8", "x"),
    "Sec-WebSocket-Protocol": ("lf.turtle", "lf.frame", "lf.jsonld, lf.turtle", "x", ","),
    "Idempotency-Key": ('"k"', "k", '"', '""', "é", "x" * 256, '"k", "k"'),
    "Lock-Token": ("<urn:uuid:00000000-0000-4000-8000-000000000000>", "x", "", "<urn:uuid:>"),
    "Last-Event-ID": ("x", "cancelled", "0", "é"),
    "Origin": ("http://evil.example", "null", "", "http://127.0.0.1", "x"),
    "Content-Encoding": ("gzip", "identity", "br", "x", ""),
    "Content-Range": ("bytes 0-1/2", "x"),
    "traceparent": ("00-0af7651916cd43dd8448eb211c80319c-b7ad6b7169203331-01", "x",
    "00-" + "0" * 32 + "-" + "0" * 16 + "-01"),
    "X-Request-ID": ("x", "\\x1b[2J", "a" * 300, ""),
    "Forwarded": ("for=x;host=evil.example;proto=https", ";"),
    "X-Forwarded-Proto": ("https", "x"),
    "X-Forwarded-Host": ("evil.example",),
    "Authorization": ("Bearer x", "Basic eDp4", "x"),
    "Cookie": ("a=b; c=d", ";", "x" * 4000),
    "Expect": ("100-continue", "x"),
    "TE": ("trailers", "x"),
    "Max-Forwards": ("0", "x"),
    "X-" + "y" * 200: ("z",),
}  # fmt: skip
_HOSTS = ("evil.example", "", "127.0.0.1", "[::1]", "127.0.0.1:99999", "a b", "x" * 300)
_FOREIGN = (
    b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n", b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03" + b"\0" * 40,
    b"GET /\r\n\r\n", b"\r\n" * 50,
    b"GET / HTTP/1.1\r\n\r\n", b"GET / HTTP/1.0\r\n\r\n", b"GET / HTTP/9.9\r\nHost: x\r\n\r\n", b"\0" * 300,
    b"SSH-2.0-x\r\n", b"",
    b"GET / HTTP/1.1\r\nHost: x\r\nHost: y\r\n\r\n", b"GET / HTTP/1.1\r\n" + b"a: b\r\n" * 3000,
    b"GET /" + b"x" * 90_000,
)  # fmt: skip
_LENGTHS = (
    b"Content-Length: 5\r\nTransfer-Encoding: chunked", b"Content-Length: 5\r\nContent-Length: 6",
    b"Content-Length: -1",
    b"Content-Length: x", b"Content-Length: 99999999999999999999", b"Transfer-Encoding: gzip, chunked",
    b"Content-Length: 300000",
    b"Transfer-Encoding: chunked\r\nTransfer-Encoding: chunked", b"Transfer-Encoding: x", b"Content-Length: +5",
    b"Content-Length: 1_0",
)  # fmt: skip
_CHUNKED = (
    b"0\r\n\r\n",
    b"5\r\nhello\r\n0\r\n\r\n",
    b"fffffffffffffffff\r\n",
    b"5;x=" + b"y" * 70_000,
    b"-1\r\n",
    b"x\r\n",
    b"5\r\nhel",
)
_POSTED = ("subscriptions", "followTrajectory", "rotateBy", "translateBy")
Request = tuple[str, bytes]


def run(count: int, seed: int, first: int = 0) -> Tally:
    with living() as there:
        crowd = Crowd(there)
        return in_batches("http", count, seed, first, there, crowd.send)


class Clients(ABC):
    """A few concurrent clients that share a sequence of inputs."""

    def send(self, tally: Tally, batch: range) -> None:
        asyncio.run(self._all(tally, iter(batch)))

    async def _all(self, tally: Tally, numbers: Iterator[int]) -> None:
        await asyncio.gather(*(self._client(tally, numbers) for _ in range(AT_ONCE)))

    @abstractmethod
    async def _client(self, tally: Tally, numbers: Iterator[int]) -> None:
        """Send the inputs with these numbers."""


class Crowd(Clients):
    """Clients that request resources."""

    def __init__(self, there: LiveGateway) -> None:
        self._port, self._paths = there.port, there.paths()
        self._subscription = there.subscribe()

    async def _client(self, tally: Tally, numbers: Iterator[int]) -> None:
        line = Line(self._port)
        try:
            for number in numbers:
                random = random_of(tally.seed, number)
                torn = random.random() < 0.14
                said = self.broken(random) if torn else self.request(random)[1]
                wrong = await (broken(self._port, said) if torn else line.ask(said, self.is_head(said)))
                if wrong:
                    tally.found(wrong, number, 1, repr(said))
        finally:
            line.close()

    @staticmethod
    def is_head(said: bytes) -> bool:
        return said.startswith(b"HEAD ")

    def request(self, random: Random) -> Request:
        """Return a well framed request, which must get a response whatever else is wrong with it."""
        if random.random() < _HOSTILE:
            return self._attack(random)
        method, path = random.choice(_METHODS), self._target(random)
        body, fields = b"", self._fields(random)
        if method in ("POST", "PUT", "DELETE", "PATCH") or random.random() < 0.03:
            body, media_type = bodies.body(random, random.choice(tuple(BODIES)))
            if random.random() < 0.7 and method in ("POST", "PUT"):
                segment = random.choice(tuple(BODIES))
                method, fields = ("POST" if segment in _POSTED else "PUT"), fields[: random.choice((1, 1, 1, 9))]
                path, (body, media_type) = bodies.path_of(segment), bodies.body(random, segment)
            if not any(field.startswith("Content-Type:") for field in fields):
                fields.append(f"Content-Type: {media_type}")
        head = "\r\n".join([f"{method} {path} HTTP/1.1", *fields])
        return method, head.encode("utf-8", "replace") + _framed(random, body)

    def _attack(self, random: Random) -> Request:
        """Return a request with a body that costs as much as possible."""
        attack = random_attack(random)
        end, accept = attack.endpoint, random.choice(ACCEPTED)
        path = end.path.replace(SUBSCRIPTION, self._subscription)
        head = (
            f"{end.method} {path} HTTP/1.1\r\nHost: 127.0.0.1:{self._port}\r\nAccept: {accept}\r\n"
            f"Content-Type: {attack.media_type}"
        )
        return end.method, head.encode() + _framed(random, attack.body)

    def _target(self, random: Random) -> str:
        path = random.choice(self._paths)
        how = random.random()
        if how < 0.25:
            pieces = path.split("/")
            for _ in range(random.choice((1, 1, 2))):
                pieces[random.randrange(len(pieces)) :][:1] = [random.choice(_PIECES)]
                pieces.insert(random.randrange(len(pieces) + 1), random.choice(_PIECES))
            path = "/".join(pieces).replace(" ", "%20")
        elif how < 0.3:
            path = random.choice(
                ("*", "", "x", "//x/", f"http://127.0.0.1:{self._port}{path}", "http://evil.example/", "/" * 500)
            )
        return path.replace(" ", "%20") + random.choice(_QUERIES).replace(" ", "%20")

    def _fields(self, random: Random) -> list[str]:
        host = f"127.0.0.1:{self._port}" if random.random() < 0.96 else random.choice(_HOSTS)
        fields = [f"Host: {host}"]
        if random.random() < _COSTLY:
            return [*fields, ": ".join(costly(random))]
        for name in random.sample(tuple(_FIELDS), random.choice((0, 1, 1, 2, 3, 6))):
            value = random.choice(_FIELDS[name])
            if random.random() < 0.1:
                spoilt = mutation.raw(random, value.encode("utf-8")).decode("latin-1")
                value = re.sub(r"[\r\n\0]", "", spoilt)
            fields += [f"{name}: {value}"] * random.choice((1, 1, 1, 1, 1, 1, 2))
        if random.random() < 0.2:
            fields += ["Connection: Upgrade", f"Upgrade: {random.choice(('websocket', 'callback'))}"]
        return fields

    def broken(self, random: Random) -> bytes:
        how = random.randrange(6)
        if how == 0:
            return random.choice(_FOREIGN)
        whole = self.request(random)[1]
        if how == 1:
            return whole[: random.randrange(len(whole) + 1)]
        if how == 2:
            return b"".join(self.request(random)[1] for _ in range(random.randint(2, 8)))
        if how == 3:
            head = f"PUT {bodies.path_of('rotate')} HTTP/1.1\r\nHost: 127.0.0.1:{self._port}\r\n".encode()
            return head + random.choice(_LENGTHS) + b"\r\n\r\n" + random.choice(_CHUNKED)
        return mutation.raw(random, whole)


def _framed(random: Random, body: bytes) -> bytes:
    if not body:
        return random.choice((b"\r\n\r\n", b"\r\n\r\n", b"\r\nContent-Length: 0\r\n\r\n"))
    if random.random() < 0.8:
        return b"\r\nContent-Length: %d\r\n\r\n" % len(body) + body
    size = random.choice((1, 7, 1000, 100_000))
    pieces = [body[at : at + size] for at in range(0, min(len(body), 200 * size), size)]
    chunks = b"".join(b"%x\r\n%b\r\n" % (len(piece), piece) for piece in pieces)
    return b"\r\nTransfer-Encoding: chunked\r\n\r\n" + chunks + b"0\r\n\r\n"


class Line:
    """A connection that is kept as long as the gateway keeps it."""

    def __init__(self, port: int) -> None:
        self._port = port
        self._open: tuple[asyncio.StreamReader, asyncio.StreamWriter] | None = None

    def close(self) -> None:
        if self._open is not None:
            self._open[1].transport.abort()
            self._open = None

    async def connect(self) -> tuple[asyncio.StreamReader, asyncio.StreamWriter]:
        return await asyncio.open_connection("127.0.0.1", self._port, limit=2**20)

    async def ask(self, said: bytes, head: bool) -> str:
        """Return what is wrong with the response; empty if nothing is."""
        fresh = self._open is None
        try:
            async with asyncio.timeout(PATIENCE_S):
                status, keep = await self._exchange(said, head)
        except TimeoutError:
            self.close()
            return "no answer in time"
        except (asyncio.IncompleteReadError, ConnectionError, asyncio.LimitOverrunError, ValueError) as error:
            self.close()
            # A kept connection may just have been closed by the server, which a client must expect.
            return f"no whole answer ({type(error).__name__})" if fresh else await self.ask(said, head)
        if not keep:
            self.close()
        return judged(status)

    async def _exchange(self, said: bytes, head: bool) -> tuple[int, bool]:
        if self._open is None:
            self._open = await self.connect()
        reader, writer = self._open
        writer.write(said)
        status, fields = await _head(reader)
        while status == 100:
            status, fields = await _head(reader)
        streaming = b"text/event-stream" in fields.get(b"content-type", b"")
        if status == 101 or streaming:
            return status, False
        await _body(reader, status, fields, head)
        return status, b"close" not in fields.get(b"connection", b"")


async def _head(reader: asyncio.StreamReader) -> tuple[int, dict[bytes, bytes]]:
    first, *lines = (await reader.readuntil(b"\r\n\r\n")).split(b"\r\n")
    fields = dict(line.lower().split(b":", 1) for line in lines if b":" in line)
    return int(first.split(b" ")[1]), fields


async def _body(reader: asyncio.StreamReader, status: int, fields: dict[bytes, bytes], head: bool) -> None:
    if head or status in (204, 304):
        return
    if b"content-length" in fields:
        await reader.readexactly(int(fields[b"content-length"]))
        return
    if b"chunked" not in fields.get(b"transfer-encoding", b""):
        await reader.read()
        return
    while size := int(await reader.readuntil(b"\r\n"), 16):
        await reader.readexactly(size + 2)
    await reader.readuntil(b"\r\n")


def judged(status: int) -> str:
    return f"answered with {status}" if status >= 500 and status not in _DOCUMENTED else ""


async def broken(port: int, said: bytes) -> str:
    """Send on a connection of its own and close after a pause, which must end the connection."""
    reader, writer = await asyncio.open_connection("127.0.0.1", port)
    heard = b""
    try:
        writer.write(said)
        try:
            while piece := await asyncio.wait_for(reader.read(2**16), _SILENCE_S):
                heard = (heard + piece)[-(2**20) :]
        except TimeoutError:
            writer.write_eof()
            async with asyncio.timeout(PATIENCE_S):
                while piece := await reader.read(2**16):
                    heard = (heard + piece)[-(2**20) :]
    except TimeoutError:
        return "a connection that its client has left stays open"
    except ConnectionError:
        return ""
    finally:
        writer.transport.abort()
    return next(filter(None, (judged(int(status)) for status in _STATUS.findall(heard))), "")
