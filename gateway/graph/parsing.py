"""Documents from clients nobody vouches for: bounded, offline, and wrong in only one way, ``ParseError``.

pyoxigraph's parsers do not recurse, but whoever walks the result may; so depth is bounded here, once.
"""

import json
import re
from collections import Counter
from collections.abc import Mapping
from typing import Any
from urllib.parse import urljoin

from pyoxigraph import BlankNode, Literal, NamedNode, RdfFormat, Triple
from pyoxigraph import parse as oxigraph_parse

from gateway.graph.outline import REST

MAX_LENGTH = 4096
_FORMATS = {
    "text/turtle": RdfFormat.TURTLE,
    "application/ld+json": RdfFormat.JSON_LD,
    "application/n-triples": RdfFormat.N_TRIPLES,
    "application/rdf+xml": RdfFormat.RDF_XML,
}
PARSEABLE = tuple(_FORMATS)

# RFC 3987 has room for U+00A0 and its like; rdflib's reader of N-Triples has not, and a person takes them for a space.
_SPACE = re.compile(r"\s")
# Strings are swallowed whole, closed or not, so that one pass over hostile input stays one pass.
_JSON_BRACKETS = re.compile(r'"(?:[^"\\]++|\\.)*+"?|[\[{]|[\]}]', re.DOTALL)


class ParseError(Exception):
    """The document cannot be taken; ``line`` and ``column`` count from 1 where the syntax tells."""

    def __init__(self, message: str, line: int | None = None, column: int | None = None) -> None:
        super().__init__(message)
        self.message, self.line, self.column = message, line, column


def parse(
    body: bytes,
    media_type: str,
    base: str,
    *,
    contexts: Mapping[str, dict[str, Any]] | None = None,
    max_triples: int = 1000,
    max_depth: int = 32,
) -> list[Triple]:
    """The default graph, with fresh blank nodes. ``contexts``: JSON-LD contexts known by IRI; none is fetched."""
    if media_type not in _FORMATS:
        raise ParseError(f"no parser for {media_type}; there are {', '.join(PARSEABLE)}")
    text = _decode(body)
    if media_type == "application/ld+json":
        text = _without_remote_contexts(text, base, contexts or {}, max_depth)
    elif media_type == "application/rdf+xml" and "<!ENTITY" in text:
        # entities of entities grow exponentially before the first triple can be counted
        raise ParseError("entity declarations are not accepted; write the characters themselves")
    triples = _bounded(text, _FORMATS[media_type], base, max_triples)
    _check_depth(triples, max_depth)
    return triples


def _decode(body: bytes) -> str:
    try:
        return body.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        good = body[: error.start]
        column = error.start - good.rfind(b"\n")
        raise ParseError(f"not UTF-8: {error.reason}", good.count(b"\n") + 1, column) from error


def _bounded(text: str, syntax: RdfFormat, base: str, max_triples: int) -> list[Triple]:
    triples: list[Triple] = []
    try:
        # fresh labels: `_:b0` of one document is not `_:b0` of another that it may be merged with
        for quad in oxigraph_parse(text, syntax, base_iri=base, without_named_graphs=True, rename_blank_nodes=True):
            if len(triples) == max_triples:
                raise ParseError(f"more than {max_triples} triples")
            triples.append(_plain(quad.triple))
    except SyntaxError as error:
        raise ParseError(_without_position(error.msg), error.lineno, error.offset) from error
    return triples


def _without_position(message: str) -> str:
    return re.sub(r"^Parser error (?:at|between) .*?: ", "", message, count=1, flags=re.DOTALL)


def _plain(triple: Triple) -> Triple:
    """The triple itself when RDF 1.1 can say it and no term is oversized."""
    value = triple.object
    if isinstance(triple.subject, Triple) or isinstance(value, Triple):
        raise ParseError("triple terms (RDF 1.2) are not accepted")
    if isinstance(value, Literal) and value.direction is not None:
        raise ParseError("base directions of text (RDF 1.2) are not accepted")
    for term in (triple.subject, triple.predicate, value):
        if len(term.value) > MAX_LENGTH:
            kind = "a literal" if isinstance(term, Literal) else "an IRI"
            raise ParseError(f"{kind} has {len(term.value)} characters, at most {MAX_LENGTH} are accepted")
        iri = term.datatype if isinstance(term, Literal) else term
        if isinstance(iri, NamedNode) and _SPACE.search(iri.value):
            raise ParseError("an IRI has white space in it")
    return triple


def _check_depth(triples: list[Triple], max_depth: int) -> None:
    """Bound the longest path over blank nodes; the length of a list is no depth, a cycle counts all its nodes."""
    edges: dict[BlankNode, list[tuple[BlankNode, int]]] = {}
    incoming: Counter[BlankNode] = Counter()
    depth: dict[BlankNode, int] = {}
    for triple in triples:
        subject, value = triple.subject, triple.object
        for node in (subject, value):
            if isinstance(node, BlankNode):
                depth.setdefault(node, 1)
        if isinstance(subject, BlankNode) and isinstance(value, BlankNode):
            edges.setdefault(subject, []).append((value, 0 if triple.predicate == REST else 1))
            incoming[value] += 1
    ready = [node for node in depth if not incoming[node]]
    reached = 0
    while ready:
        node = ready.pop()
        reached += 1
        for value, step in edges.get(node, ()):
            depth[value] = max(depth[value], depth[node] + step)
            incoming[value] -= 1
            if not incoming[value]:
                ready.append(value)
    if max(depth.values(), default=0) + len(depth) - reached > max_depth:
        raise ParseError(f"blank nodes are nested more than {max_depth} deep")


def _without_remote_contexts(text: str, base: str, contexts: Mapping[str, dict[str, Any]], max_depth: int) -> str:
    """The JSON with the contexts that we know put in place of their IRIs."""
    check_json_depth(text, max_depth)
    if '"@context"' not in text and "\\" not in text:
        return text  # the parser then sees, and reports positions of, exactly what the client sent
    try:
        document = json.loads(text, parse_constant=_no_constant)
        replaced = _embed(document, base, contexts)
        return text if replaced == document else json.dumps(replaced, allow_nan=False)
    except json.JSONDecodeError as error:
        raise ParseError(error.msg, error.lineno, error.colno) from error
    except ValueError as error:  # a number beyond float, or beyond int's digits
        raise ParseError(f"unacceptable JSON: {error}") from error


def check_json_depth(text: str, max_depth: int) -> None:
    depth = 0
    for match in _JSON_BRACKETS.finditer(text):
        bracket = match[0]
        depth += 1 if bracket in "[{" else -1 if bracket in "]}" else 0
        if depth > max_depth:
            line = text.count("\n", 0, match.start()) + 1
            column = match.start() - text.rfind("\n", 0, match.start())
            raise ParseError(f"JSON is nested more than {max_depth} deep", line, column)


def _no_constant(name: str) -> float:
    raise ParseError(f"{name} is not JSON")


def _embed(value: Any, base: str, contexts: Mapping[str, dict[str, Any]]) -> Any:
    if isinstance(value, list):
        return [_embed(item, base, contexts) for item in value]
    if not isinstance(value, dict):
        return value
    return {
        key: _context(item, base, contexts)
        if key == "@context"
        else item
        if key == "@value"
        else _embed(item, base, contexts)
        for key, item in value.items()
    }


def _context(value: Any, base: str, contexts: Mapping[str, dict[str, Any]]) -> Any:
    if isinstance(value, list):
        return [_context(item, base, contexts) for item in value]
    if not isinstance(value, str):
        return _embed(value, base, contexts)
    try:
        known = contexts.get(value) or contexts.get(urljoin(base, value))
    except ValueError as error:
        raise ParseError(f"{value!r} is no IRI") from error
    if known is None:
        raise ParseError(f"remote contexts are never fetched ({value}); known: {', '.join(contexts) or 'none'}")
    return known.get("@context", known)
