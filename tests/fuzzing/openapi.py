"""Operations that a real gateway describes in OpenAPI, called as described and with mutations."""

import asyncio
import json
from collections.abc import Iterator
from random import Random
from typing import Any
from urllib.parse import quote

import httpx

from fuzzing import mutation
from fuzzing.findings import Tally, random_of
from fuzzing.http import Clients, Line
from fuzzing.living import PATIENCE_S, LiveGateway, in_batches, living

_DESCRIPTION = "/openapi.json"
_METHODS = ("get", "put", "post", "patch", "delete")
_ID = "00000000-0000-4000-8000-000000000000"
_TEXTS = {
    "application/sparql-query": ("ASK { ?s ?p ?o }", "SELECT * { ?s ?p ?o } LIMIT 2", "ASK {", ""),
    "application/sparql-update": ("DELETE DATA { <x> <y> 1 }", "INSERT DATA { <> <y> 1 }", "DELETE WHERE { ?s ?p ?o }"),
}
_FIELDS = {
    "accept": ("application/json", "application/ld+json", "text/turtle", "*/*", "text/csv", "x", ""),
    "prefer": ("return=representation", "respond-async", "wait=0.1", "dry-run", "dry-run, wait=0", "x"),
    "if-match": ("*", '"x"', "x"),
    "if-none-match": ("*", '"x"', 'W/"x"'),
    "idempotency-key": ('"k"', "k", ""),
    "accept-encoding": ("gzip", "identity;q=0", "x"),
}


def run(count: int, seed: int, first: int = 0) -> Tally:
    with living() as there:
        callers = Callers(there)
        return in_batches("openapi", count, seed, first, there, callers.send)


class Callers(Clients):
    """Clients that call the described operations, and read the description in between."""

    def __init__(self, there: LiveGateway) -> None:
        url = f"http://127.0.0.1:{there.port}{_DESCRIPTION}"
        answer = httpx.get(url, headers={"accept": "application/json"}, timeout=PATIENCE_S)
        self._port, paths = there.port, answer.json()["paths"]
        self._operations = [
            (method, template, item) for template, item in paths.items() for method in _METHODS if method in item
        ]

    async def _client(self, tally: Tally, numbers: Iterator[int]) -> None:
        line = Line(self._port)
        try:
            for number in numbers:
                said = self.request(random_of(tally.seed, number))
                if wrong := await line.ask(said, head=False):
                    tally.found(wrong, number, 1, repr(said))
                await asyncio.sleep(0)
        finally:
            line.close()

    def request(self, random: Random) -> bytes:
        """Return a request; one in three is as described, and all must be answered."""
        good = random.random() < 0.3
        method, template, item = random.choice(self._operations)
        if random.random() < 0.1:
            method, template, item = "get", _DESCRIPTION, {"get": {}}
        operation = item[method]
        path = template
        for each in item.get("parameters", ()):
            path = path.replace(f"{{{each['name']}}}", quote(_text(random, each["schema"], good), safe=""))
        asked = [
            each for each in operation.get("parameters", ()) if each.get("in") == "query" and random.random() < 0.5
        ]
        query = "&".join(f"{each['name']}={quote(_text(random, each['schema'], good))}" for each in asked)
        fields = {name: random.choice(_FIELDS[name]) for name in random.sample(list(_FIELDS), random.randint(0, 3))}
        kind, content = _body(random, operation, good)
        if kind:
            fields |= {"content-type": kind if good or random.random() < 0.9 else "application/x"}
        fields |= {"host": f"127.0.0.1:{self._port}", "content-length": str(len(content))}
        head = [f"{method.upper()} {path}{'?' + query if query else ''} HTTP/1.1"]
        head += [f"{name}: {value}" for name, value in fields.items()]
        return "\r\n".join([*head, "", ""]).encode() + content


def _text(random: Random, schema: dict[str, Any], good: bool) -> str:
    """Return a value of a parameter: a listed one, or another."""
    if not good and random.random() < 0.3:
        return str(random.choice(mutation.TEXTS)).encode("utf-8", "replace").decode()[:500]
    known = schema.get("enum") or schema.get("examples")
    if known:
        return str(random.choice(known))
    if schema.get("type") == "integer":
        return str(random.choice((0, 1, 7, 10**9)))
    return random.choice(("PT10S", "2026-01-01T00:00:00Z", _ID)) if schema.get("format") != "uuid" else _ID


def _body(random: Random, operation: dict[str, Any], good: bool) -> tuple[str, bytes]:
    """Return media type and content: an example of the description, mutated as a tree unless it must be ``good``."""
    bodies = operation.get("requestBody", {}).get("content", {})
    if not bodies:
        return "", b""
    kind = random.choice(list(bodies))
    if kind in _TEXTS:
        text = random.choice(_TEXTS[kind]).encode()
        return kind, text if good else mutation.raw(random, text)
    examples = [each["value"] for each in bodies[kind].get("examples", {}).values()] or [{}]
    example = json.loads(json.dumps(random.choice(examples)))
    if good:
        return kind, json.dumps(example).encode()
    return kind, mutation.dumped(mutation.tree(random, example))[:60_000]
