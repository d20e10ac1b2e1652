"""Serialization of triples in every RDF media type that the gateway offers (reading: ``linked_fleet_rdf.parsing``).

The same triples in the same order give the same bytes, so that an ETag can be the hash of the body.
"""

import re
from collections.abc import Iterable, Mapping, Sequence
from itertools import count
from typing import TypeVar

from pyoxigraph import BlankNode, Literal, NamedNode, RdfFormat, Triple, serialize

from linked_fleet_rdf import jsonld, turtle
from linked_fleet_rdf.parsing import ParseError, parse
from linked_fleet_rdf.turtle import TYPE, Outline, Subject, Term

__all__ = [
    "JELLY", "JSON", "N_TRIPLES", "RDF_TYPES", "TEXT_TYPES", "ParseError", "WriteError", "n_triples", "parse", "render",
]  # fmt: skip

JELLY = "application/x-jelly-rdf"
JSON = "application/json"
N_TRIPLES = "application/n-triples"
TEXT_TYPES = ("text/turtle", "application/ld+json", N_TRIPLES, "application/rdf+xml")
RDF_TYPES = (*TEXT_TYPES, JELLY)

_T = TypeVar("_T", bound=Term)

# RDF/XML, 5.1.2: predicates, and types that pyoxigraph writes as elements, must end in an XML name.
_XML_NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_.-]*$")
# XML 1.0, 2.2 cannot represent these characters, not even as references.
_NO_XML = re.compile("[\x00-\x08\x0b\x0c\x0e-\x1f\ufffe\uffff]")


class WriteError(ValueError):
    """The syntax cannot represent these triples; another one can."""


class NoContentYet(WriteError):  # noqa: N818 -- a state, not a defect
    """There is no content yet, but there will be. This is not reported as an error."""


def render(triples: Sequence[Triple], media_type: str, prefixes: Mapping[str, str], *, base: str) -> bytes:
    """Return the document in one of ``RDF_TYPES``. Raises ValueError for other types, such as HTML
    (``extensions.pages``).

    ``base`` is the IRI of the document.
    """
    match media_type:
        case "text/turtle":
            return turtle.write_turtle(triples, prefixes, base).encode()
        case "application/ld+json":
            return jsonld.write_jsonld(triples, prefixes).encode()
        case "application/n-triples":
            return n_triples(triples)
        case "application/rdf+xml":
            return _rdf_xml(triples, prefixes)
        case "application/x-jelly-rdf":
            from linked_fleet_rdf import jelly

            return jelly.write_jelly(_relabelled(triples))
    raise ValueError(f"no writer for {media_type}; there are {', '.join(RDF_TYPES)}")


def n_triples(statements: Iterable[Triple | tuple[Subject, NamedNode, Term]]) -> bytes:
    """Return the statements in N-Triples, grouped and with blank nodes renamed as in all other syntaxes."""
    texts: dict[Term, str] = {}
    numbers = count()

    def text(term: Term) -> str:
        found = texts.get(term)
        if found is None:
            if isinstance(term, Triple):
                raise TypeError("triple terms (RDF 1.2) have no place in our documents")
            found = texts[term] = f"_:b{next(numbers)}" if isinstance(term, BlankNode) else str(term)
        return found

    grouped: dict[Term, dict[NamedNode, list[Term]]] = {}
    for subject, predicate, value in dict.fromkeys(statements):
        grouped.setdefault(subject, {}).setdefault(predicate, []).append(value)
    lines: list[str] = []
    for subject, properties in grouped.items():
        start = text(subject)
        for predicate, values in properties.items():
            begun = f"{start} {text(predicate)} "
            lines += [f"{begun}{text(value)} .\n" for value in values]
    return "".join(lines).encode()


def _relabelled(triples: Sequence[Triple]) -> list[Triple]:
    """Group triples by subject and rename blank nodes b0, b1, … in order of appearance, for stable output."""
    outline = Outline(triples)

    def named(term: _T) -> BlankNode | _T:
        return BlankNode(outline.label(term)) if isinstance(term, BlankNode) else term

    return [
        Triple(named(subject), predicate, named(value))
        for subject, properties in outline.properties.items()
        for predicate, values in properties.items()
        for value in values
    ]


def _rdf_xml(triples: Sequence[Triple], prefixes: Mapping[str, str]) -> bytes:
    """Write RDF/XML with the prefixes of its predicates; characters that XML cannot hold become U+FFFD.

    Raises WriteError for a predicate or type without an XML name.
    """
    names = turtle.Names({prefix: namespace for prefix, namespace in prefixes.items() if prefix != "rdf"})
    for triple in triples:
        names.prefixed(triple.predicate.value)
        for name in (triple.predicate, triple.object if triple.predicate == TYPE else triple.predicate):
            if isinstance(name, NamedNode) and not _XML_NAME.search(name.value):
                raise WriteError(f"RDF/XML cannot name {name.value}")
    writable = [Triple(t.subject, t.predicate, _xml_safe(t.object)) for t in _relabelled(triples)]
    return _oxigraph(writable, RdfFormat.RDF_XML, dict(sorted(names.used.items())))


def _oxigraph(triples: Sequence[Triple], syntax: RdfFormat, prefixes: dict[str, str]) -> bytes:
    # without base_iri, because pyoxigraph would shorten prefixes to scheme-relative `//host`
    return serialize(triples, format=syntax, prefixes=prefixes) or b""  # None only when it writes to a file


def _xml_safe(term: NamedNode | BlankNode | Literal | Triple) -> NamedNode | BlankNode | Literal | Triple:
    if not isinstance(term, Literal) or not _NO_XML.search(term.value):
        return term
    text = _NO_XML.sub("\ufffd", term.value)
    return Literal(text, language=term.language) if term.language else Literal(text, datatype=term.datatype)
