"""Mutated JSON-RPC messages of the Model Context Protocol, with and without sessions."""

import json
from collections.abc import Iterator
from copy import deepcopy
from random import Random
from typing import Any

from fuzzing import mutation
from fuzzing.findings import Tally, random_of
from fuzzing.http import Clients, Line, _body, _head
from fuzzing.living import LiveGateway, in_batches, living

_VERSIONS = ("2024-11-05", "2025-03-26", "2025-06-18", "2025-11-25", "2026-07-28")
_MODERN = _VERSIONS[-1]
_DEGREE = "http://qudt.org/vocab/unit/DEG"
_ROTATE = "/arm/pan/actions/rotate"
_CALLS: tuple[tuple[str, dict[str, Any]], ...] = (
    ("find", {"text": "arm", "kind": "action", "robot": "arm", "limit": 3}),
    ("read", {"target": "/arm/pan/rotation", "format": "json"}),
    ("query", {"query": "ASK { ?s ?p ?o }"}),
    ("rehearse", {"action": _ROTATE, "body": {"value": 3.0, "unit": _DEGREE}}),
    ("act", {"action": _ROTATE, "body": {"value": 3.0, "unit": _DEGREE}, "wait_s": 0.1, "rehearse": False}),
    ("stop", {"target": "/arm/"}),
)
_REQUESTS: tuple[tuple[str, dict[str, Any]], ...] = (
    ("ping", {}), ("tools/list", {}), ("resources/list", {"cursor": "x"}), ("resources/templates/list", {}),
    ("resources/read", {"uri": "/arm/"}), ("prompts/list", {}), ("logging/setLevel", {"level": "debug"}),
    ("resources/subscribe", {"uri": "/arm/"}), ("completion/complete", {}), ("server/discover", {}),
    ("subscriptions/listen", {}), ("initialize", {}),
)  # fmt: skip
_NOTES: tuple[tuple[str, dict[str, Any]], ...] = (
    ("notifications/cancelled", {"requestId": 1}), ("notifications/initialized", {}),
    ("notifications/progress", {"progressToken": 1, "progress": 0.5}), ("notifications/roots/list_changed", {}),
)  # fmt: skip
_INITIALIZE = {"capabilities": {}, "clientInfo": {"name": "fuzz", "version": "1"}}
_ACCEPTS = ("application/json, text/event-stream",) * 6 + ("application/json", "text/event-stream", "*/*", "", "x")
_ENVELOPE = "io.modelcontextprotocol/"


def run(count: int, seed: int, first: int = 0) -> Tally:
    with living() as there:
        crowd = Crowd(there)
        return in_batches("mcp", count, seed, first, there, crowd.send)


class Crowd(Clients):
    """Clients with one session each, which is opened again when it is lost."""

    def __init__(self, there: LiveGateway) -> None:
        self._port = there.port

    async def _client(self, tally: Tally, numbers: Iterator[int]) -> None:
        line = _Line(self._port)
        try:
            await line.open()
            for number in numbers:
                said = message(random_of(tally.seed, number), self._port, line.session)
                wrong = await line.ask(said, head=False)
                if wrong:
                    tally.found(wrong, number, 1, repr(said))
                if b"404" in line.status or b"DELETE" in said[:6]:
                    await line.open()
            await line.ask(_framed("DELETE", self._port, {"mcp-session-id": line.session}, b""), head=False)
        finally:
            line.close()


def message(random: Random, port: int, session: str) -> bytes:
    """Return an HTTP request with a message; most are invalid."""
    version = random.choice(_VERSIONS)
    fields = {"accept": random.choice(_ACCEPTS), "content-type": "application/json", "mcp-protocol-version": version}
    if version != _MODERN and random.random() < 0.95:
        fields["mcp-session-id"] = session
    said = _said(random, version)
    if version == _MODERN and isinstance(said.get("params"), dict):
        fields |= {"mcp-method": str(said["method"]), "mcp-name": str(said["params"].get("name", ""))}
    content = _content(random, said)
    if random.random() < 0.15:
        name = random.choice(tuple(fields))
        fields[name] = random.choice(("", "x", "*", "a" * 900, "2099-01-01", "application/json; charset=x", "%00"))
    method = random.choice(("POST",) * 30 + ("GET", "DELETE", "PUT", "OPTIONS"))
    return _framed(method, port, fields, content)


def _said(random: Random, version: str) -> dict[str, Any]:
    how = random.random()
    if how < 0.7:
        name, arguments = random.choice(_CALLS)
        method, params = "tools/call", {"name": name, "arguments": dict(arguments)}
    else:
        method, params = random.choice(_NOTES if how > 0.9 else _REQUESTS)
        params = {**params, **(_INITIALIZE | {"protocolVersion": version} if method == "initialize" else {})}
    meta: dict[str, Any] = {"progressToken": random.randrange(4)} if random.random() < 0.5 else {}
    if version == _MODERN:
        meta |= {_ENVELOPE + "protocolVersion": version, _ENVELOPE + "clientCapabilities": {}}
    if meta:
        params = {**params, "_meta": meta}
    said: dict[str, Any] = {"jsonrpc": "2.0", "method": method, "params": params}
    return said if method.startswith("notifications/") else {**said, "id": random.randrange(1_000_000)}


def _content(random: Random, said: dict[str, Any]) -> bytes:
    how = random.random()
    if how < 0.3:
        return json.dumps(said).encode()
    if how < 0.9:
        return mutation.dumped(mutation.tree(random, deepcopy(said)))
    return mutation.raw(random, json.dumps([said] * random.choice((1, 1, 9)) if how > 0.97 else said).encode())


def _framed(method: str, port: int, fields: dict[str, str], content: bytes) -> bytes:
    head = [f"{method} /mcp HTTP/1.1", f"host: 127.0.0.1:{port}", f"content-length: {len(content)}"]
    return "\r\n".join([*head, *(f"{name}: {value}" for name, value in fields.items()), "", ""]).encode() + content


class _Line(Line):
    """A connection on which streams are read to their ends, which come soon."""

    session, status = "", b""

    async def open(self) -> None:
        """Open a session."""
        fields = {"accept": _ACCEPTS[0], "content-type": "application/json"}
        params = {**_INITIALIZE, "protocolVersion": _VERSIONS[-2]}
        said = {"jsonrpc": "2.0", "id": 0, "method": "initialize", "params": params}
        self.session = ""
        await self.ask(_framed("POST", self._port, fields, json.dumps(said).encode()), head=False)

    async def _exchange(self, said: bytes, head: bool) -> tuple[int, bool]:
        if self._open is None:
            self._open = await self.connect()
        reader, writer = self._open
        writer.write(said)
        status, fields = await _head(reader)
        self.status = str(status).encode()
        if (id := fields.get(b"mcp-session-id", b"").strip().decode()) and not self.session:
            self.session = id
        await _body(reader, status, fields, head)
        return status, b"close" not in fields.get(b"connection", b"")
