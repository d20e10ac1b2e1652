"""Parsers of untrusted RDF documents: bounded, offline, with ``ParseError`` as the only error.

pyoxigraph's parsers do not recurse, but code that walks the result may, so depth is bounded here.
"""

import re
from collections.abc import Mapping
from itertools import islice
from typing import Any

from pyoxigraph import BlankNode, Literal, NamedNode, RdfFormat, Triple
from pyoxigraph import parse as oxigraph_parse

from linked_fleet_rdf.json_input import InputTooLargeError, ParseError, check_jsonld
from linked_fleet_rdf.turtle import REST

__all__ = ["MAX_LENGTH", "PARSEABLE", "ParseError", "parse"]

MAX_TRIPLES = 1000
MAX_LENGTH = 4096
_JSON_VALUES = 8  # JSON-LD values for each permitted triple
_FORMATS = {
    "text/turtle": RdfFormat.TURTLE,
    "application/ld+json": RdfFormat.JSON_LD,
    "application/n-triples": RdfFormat.N_TRIPLES,
    "application/rdf+xml": RdfFormat.RDF_XML,
}
PARSEABLE = tuple(_FORMATS)

_BYTE_ORDER_MARK = "\ufeff"
# Each declaration is resolved against the previous one or compared with all others, so the time grows quadratically.
_MOST_DECLARATIONS = 256
_DECLARATIONS = {
    "text/turtle": ("base", re.compile(r"(?<![\w:.-])@?base(?=[\s<#])", re.IGNORECASE), "base IRIs"),
    "application/rdf+xml": ("xmlns", re.compile("xmlns"), "namespaces"),
}


def parse(
    body: bytes,
    media_type: str,
    base: str,
    *,
    contexts: Mapping[str, dict[str, Any]] | None = None,
    max_triples: int = MAX_TRIPLES,
    max_depth: int = 32,
    lengths: Mapping[NamedNode, int] | None = None,
) -> list[Triple]:
    """Return the default graph, with fresh blank nodes. JSON-LD ``contexts`` are known by IRI; none is fetched.

    ``lengths`` gives the maximum number of characters of literals by predicate; all other terms have at most
    MAX_LENGTH. Raises ParseError.
    """
    if media_type not in _FORMATS:
        raise ParseError(f"no parser for {media_type}; there are {', '.join(PARSEABLE)}")
    text = _decode(body)
    if media_type == "application/ld+json":
        text = check_jsonld(text, base, contexts or {}, max_depth, max_triples * _JSON_VALUES)
    elif media_type == "application/rdf+xml" and "<!ENTITY" in text:
        # nested entities grow exponentially before the first triple can be counted
        raise ParseError("entity declarations are not accepted; write the characters themselves")
    _check_declarations(text, media_type)
    triples = _bounded(text, _FORMATS[media_type], base, max_triples, lengths or {})
    _check_depth(triples, max_depth)
    return triples


def _check_declarations(text: str, media_type: str) -> None:
    if media_type in _DECLARATIONS:
        word, pattern, what = _DECLARATIONS[media_type]
        if text.lower().count(word) <= _MOST_DECLARATIONS:  # twenty times as fast as the pattern
            return
        if sum(1 for _ in islice(pattern.finditer(text), _MOST_DECLARATIONS + 1)) > _MOST_DECLARATIONS:
            raise ParseError(f"more than {_MOST_DECLARATIONS} {what} are declared")


def _decode(body: bytes) -> str:
    try:
        return body.decode().removeprefix(_BYTE_ORDER_MARK)
    except UnicodeDecodeError as error:
        good = body[: error.start]
        column = error.start - good.rfind(b"\n")
        raise ParseError(f"not UTF-8: {error.reason}", good.count(b"\n") + 1, column) from error


def _bounded(
    text: str, syntax: RdfFormat, base: str, max_triples: int, lengths: Mapping[NamedNode, int]
) -> list[Triple]:
    triples: list[Triple] = []
    try:
        # fresh labels, because `_:b0` of another document is another node
        for quad in oxigraph_parse(text, syntax, base_iri=base, without_named_graphs=True, rename_blank_nodes=True):
            if len(triples) == max_triples:
                raise InputTooLargeError(f"more than {max_triples} triples")
            triples.append(_plain(quad.triple, lengths))
    except SyntaxError as error:
        raise ParseError(_without_position(error.msg), error.lineno, error.offset) from error
    return triples


def _without_position(message: str) -> str:
    return re.sub(r"^Parser error (?:at|between) .*?: ", "", message, count=1, flags=re.DOTALL)


def _plain(triple: Triple, lengths: Mapping[NamedNode, int]) -> Triple:
    """Return the triple if RDF 1.1 allows it and no term is too long. Raises ParseError."""
    subject, predicate, value = triple
    if isinstance(subject, Triple) or isinstance(value, Triple):
        raise ParseError("triple terms (RDF 1.2) are not accepted")
    _check_iri(predicate)
    if isinstance(subject, NamedNode):
        _check_iri(subject)
    if isinstance(value, Literal):
        if value.direction is not None:
            raise ParseError("base directions of text (RDF 1.2) are not accepted")
        if len(value.value) > (most := lengths.get(predicate, MAX_LENGTH)):
            raise ParseError(f"a literal has {len(value.value)} characters, at most {most} are accepted")
        _check_iri(value.datatype)
    elif isinstance(value, NamedNode):
        _check_iri(value)
    return triple


def _check_iri(iri: NamedNode) -> None:
    text = iri.value
    if len(text) > MAX_LENGTH:
        raise ParseError(f"an IRI has {len(text)} characters, at most {MAX_LENGTH} are accepted")
    # RFC 3987 allows U+00A0 and similar characters. rdflib's N-Triples parser refuses them, and they look like spaces.
    if text.split() != [text]:
        raise ParseError("an IRI has white space in it")


def _check_depth(triples: list[Triple], max_depth: int) -> None:
    """Bound the longest path over blank nodes. Lists count as one level; a cycle counts all its nodes."""
    edges: dict[BlankNode, list[tuple[BlankNode, int]]] = {}
    incoming: dict[BlankNode, int] = {}
    depth: dict[BlankNode, int] = {}
    for triple in triples:
        subject, predicate, value = triple
        if isinstance(subject, BlankNode):
            depth.setdefault(subject, 1)
        if not isinstance(value, BlankNode):
            continue
        depth.setdefault(value, 1)
        if isinstance(subject, BlankNode):
            edges.setdefault(subject, []).append((value, 0 if predicate == REST else 1))
            incoming[value] = incoming.get(value, 0) + 1
    if not depth:
        return
    ready = [node for node in depth if node not in incoming]
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
