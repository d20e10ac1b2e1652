"""Bodies from clients against SHACL shapes: bounded before pySHACL sees them, answered in words after."""

import logging
import math
import re
import warnings
from collections.abc import Sequence
from typing import TYPE_CHECKING

from pyoxigraph import BlankNode, Literal, NamedNode, RdfFormat, Triple, parse, serialize

from gateway.base.errors import UnprocessableContent
from gateway.base.lazy_imports import Lazily
from gateway.rdf.graph import Node
from gateway.rdf.vocabulary import NUMERIC, RDF, SH, XSD

if TYPE_CHECKING:
    import pyshacl
    import rdflib
else:
    pyshacl = Lazily("pyshacl")
    rdflib = Lazily("rdflib")

# rdflib logs the conversion traceback of every ill-typed literal; such literals are answered below, in words.
logging.getLogger("rdflib.term").setLevel(logging.ERROR)

# The lexical spaces of XML Schema 2, 3.2 and 3.3 (RDF 1.1 Concepts, 5.1), without the white space that only XML
# collapses. Python's float takes more, such as 1_0.
_INTEGER = re.compile(r"[+-]?[0-9]+")
_DECIMAL = re.compile(r"[+-]?(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)")
_FLOAT = re.compile(r"[+-]?(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][+-]?[0-9]+)?")
_LEXICAL = {XSD.decimal: _DECIMAL, XSD.float: _FLOAT, XSD.double: _FLOAT}
_XML_NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_.-]*\Z")
FOCUS = NamedNode("urn:linked-fleet:body")


def root(body: Sequence[Triple], request: NamedNode) -> Node:
    """``<>``, else the only subject that is nobody's object (DESIGN: "body of an action")."""
    subjects = dict.fromkeys(t.subject for t in body)
    if request in subjects:
        return request
    objects = {t.object for t in body}
    roots = [s for s in subjects if s not in objects]
    if len(roots) != 1:
        found = "no triples" if not body else f"{len(roots)} subjects that nobody refers to"
        raise UnprocessableContent(
            f"The body has {found}; it needs one root: <> (the request URI), or the only subject "
            "that is nobody's object.",
            constraint=request.value,
        )
    return roots[0]  # type: ignore[return-value]


def check_writable(triples: Sequence[Triple], constraint: str) -> None:
    """UnprocessableContent for a predicate that RDF/XML has no name for: who reads that could not read it back."""
    unwritable = [t.predicate.value for t in triples if not _XML_NAME.search(t.predicate.value)]
    if unwritable:
        raise UnprocessableContent(
            f"RDF/XML cannot say <{unwritable[0][:200]}>: a predicate ends in a name, such as label or isOwnedBy.",
            constraint=constraint,
        )


def check_lexical_forms(body: Sequence[Triple], constraint: str) -> None:
    for triple in body:
        literal = triple.object
        if isinstance(literal, Literal) and literal.datatype in NUMERIC:
            lexical = _LEXICAL.get(literal.datatype, _INTEGER).fullmatch(literal.value)
            if not lexical or not math.isfinite(float(literal.value)):
                raise UnprocessableContent(
                    f"{literal.value[:80]!r} is no finite number of type {literal.datatype.value}; write e.g. 43.6.",
                    constraint=constraint,
                )


def focused(about: Sequence[Triple]) -> "rdflib.Graph":
    """Data for pySHACL: what is said about the root of a body, as if it were about FOCUS."""
    return to_rdflib([Triple(FOCUS, t.predicate, t.object) for t in about])


def targeted(triples: Sequence[Triple], shape: Node) -> "rdflib.Graph":
    """The shapes for pySHACL; ``shape`` judges FOCUS whatever its type, which a body need not state."""
    own = [Triple(shape, RDF.type, SH.NodeShape), Triple(shape, SH.targetNode, FOCUS)]
    return to_rdflib([*triples, *own])


def validate(data: "rdflib.Graph", shapes: "rdflib.Graph") -> "tuple[bool, rdflib.Graph]":
    conforms, report, _ = pyshacl.validate(data, shacl_graph=shapes, inference="none", advanced=False)
    return bool(conforms), report


def from_rdflib(report: "rdflib.Graph", request_iri: str) -> list[Triple]:
    """The report as triples about the request."""
    # Messages name the focus node as well, so it is renamed in the text and not term by term.
    text = report.serialize(format="nt").replace(FOCUS.value, request_iri)
    labels: dict[str, BlankNode] = {}

    def relabel(term: object) -> object:
        return labels.setdefault(term.value, BlankNode(f"r{len(labels)}")) if isinstance(term, BlankNode) else term

    quads = parse(text, format=RdfFormat.N_TRIPLES)
    return [Triple(relabel(q.subject), q.predicate, relabel(q.object)) for q in quads]  # type: ignore[arg-type]


def to_rdflib(triples: Sequence[Triple]) -> "rdflib.Graph":
    text = serialize(triples, format=RdfFormat.N_TRIPLES)
    with warnings.catch_warnings(action="ignore"):  # of odd booleans and the like, which the shape refuses in words
        return rdflib.Graph().parse(data=text, format="nt")
