"""The guard of an action's body: pySHACL on the very shape that the action's description links (paper 5.4)."""

import logging
import math
import re
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import pyshacl
import rdflib
from pyoxigraph import BlankNode, Literal, NamedNode, RdfFormat, Triple, parse, serialize

from gateway.errors import UnprocessableContent
from gateway.fleet.model import Joint
from gateway.graph.actions import NUMERIC, branch, consumes, units
from gateway.graph.build import Graph, Node
from gateway.graph.vocab import SH, VOM, XSD

# rdflib logs the conversion traceback of every ill-typed literal; such literals are answered below, in words.
logging.getLogger("rdflib.term").setLevel(logging.ERROR)

# XML Schema 2, 3.2 and 3.3, with the white space around that it collapses; Python's float takes more, such as 1_0.
_INTEGER = re.compile(r"[ \t\r\n]*[+-]?[0-9]+[ \t\r\n]*")
_DECIMAL = re.compile(r"[ \t\r\n]*[+-]?(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)[ \t\r\n]*")
_FLOAT = re.compile(r"[ \t\r\n]*[+-]?(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][+-]?[0-9]+)?[ \t\r\n]*")
_LEXICAL = {XSD.decimal: _DECIMAL, XSD.float: _FLOAT, XSD.double: _FLOAT}
_NO_BRANCH = re.compile(r"Node .*\(OrConstraintComponent\)", re.DOTALL)
# pySHACL writes Literal("59.98", datatype=xsd:decimal) in its messages; a person reads 59.98.
_LITERAL = re.compile(r'Literal\("([^"]*)"[^)]*\)')
_FOCUS = NamedNode("urn:linked-fleet:body")


@dataclass(frozen=True)
class Quantity:
    """What an admitted body says: a finite number and the IRI of its unit."""

    value: float
    unit: NamedNode


def admit(body: Sequence[Triple], joint: Joint, request_iri: str) -> Quantity:
    """Return the quantity in ``body``; UnprocessableContent with the validation report when the shape refuses it."""
    focus = _root(body, NamedNode(request_iri))
    # What else a body says is nobody's business: not the shape's, nor rdflib's, which converts every literal. And two
    # values break a maxCount as well as a thousand, which would keep pySHACL busy for seconds.
    about = dict.fromkeys(t for t in body if t.subject == focus)
    body = [t for p in (VOM.numericalValue, VOM.unit) for t in [t for t in about if t.predicate == p][:2]]
    _check_lexical_forms(body, request_iri)
    data = _to_rdflib([Triple(_FOCUS, t.predicate, t.object) for t in body])
    conforms, report = _validate(data, _guard(joint))
    if not conforms:
        raise _refusal(data, report, joint, request_iri)
    stated = {t.predicate: t.object for t in body}
    value, unit = stated[VOM.numericalValue], stated[VOM.unit]
    assert isinstance(value, Literal) and isinstance(unit, NamedNode)
    return Quantity(float(value.value), unit)


def _root(body: Sequence[Triple], request: NamedNode) -> Node:
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


def _check_lexical_forms(body: Sequence[Triple], constraint: str) -> None:
    for triple in body:
        literal = triple.object
        if isinstance(literal, Literal) and literal.datatype in NUMERIC:
            lexical = _LEXICAL.get(literal.datatype, _INTEGER).fullmatch(literal.value)
            if not lexical or not math.isfinite(float(literal.value)):
                raise UnprocessableContent(
                    f"{literal.value[:80]!r} is no finite number of type {literal.datatype.value}; write e.g. 43.6.",
                    constraint=constraint,
                )


def _to_rdflib(triples: Sequence[Triple]) -> rdflib.Graph:
    text = serialize(triples, format=RdfFormat.N_TRIPLES)
    with warnings.catch_warnings(action="ignore"):  # of odd booleans and the like, which the shape refuses in words
        return rdflib.Graph().parse(data=text, format="nt")


def _targeted(graph: Graph, shape: Node) -> rdflib.Graph:
    graph.a(shape, SH.NodeShape)
    graph.add(shape, SH.targetNode, _FOCUS)
    # The focus node alone is judged: other scalars in the body are triples that the shape does not cover.
    return _to_rdflib([t for t in graph.triples if t.predicate != SH.targetClass])


@lru_cache(maxsize=4096)
def _guard(joint: Joint) -> rdflib.Graph:
    graph = Graph()
    return _targeted(graph, consumes(graph, joint))


@lru_cache(maxsize=4096)
def _branch(joint: Joint, index: int) -> rdflib.Graph:
    graph = Graph()
    return _targeted(graph, branch(graph, joint, units(joint)[index]))


def _validate(data: rdflib.Graph, shapes: rdflib.Graph) -> tuple[bool, rdflib.Graph]:
    conforms, report, _ = pyshacl.validate(data, shacl_graph=shapes, inference="none", advanced=False)
    return bool(conforms), report


def _refusal(data: rdflib.Graph, report: rdflib.Graph, joint: Joint, request_iri: str) -> UnprocessableContent:
    """Name the constraint that failed: inside ``sh:or`` that of the branch of the unit that the body states."""
    messages = _messages(report)
    # Of the sh:or over the branches pySHACL says only that none holds; whatever else it says is more to the point.
    telling = [message for message in messages if not _NO_BRANCH.fullmatch(message)]
    stated = {str(o) for o in data.objects(rdflib.URIRef(_FOCUS.value), rdflib.URIRef(VOM.unit.value))}
    for index, unit in enumerate(units(joint)):
        if not telling and stated & {i.value for i in unit.accepted}:
            conforms, inner = _validate(data, _branch(joint, index))
            if not conforms:
                report, messages = inner, _messages(inner)
    detail = "The body does not conform to the shape of the action: " + "; ".join(
        _LITERAL.sub(r"\1", message.rpartition(" (")[0]).replace(f"<{_FOCUS.value}>", "the body")
        for message in telling or messages
    )
    return UnprocessableContent(detail, report=_from_rdflib(report, request_iri), constraint=request_iri)


def _messages(report: rdflib.Graph) -> list[str]:
    found = []
    for result in report.subjects(rdflib.SH.resultMessage):
        message = report.value(result, rdflib.SH.resultMessage)
        path = report.value(result, rdflib.SH.resultPath)
        component = str(report.value(result, rdflib.SH.sourceConstraintComponent)).rpartition("#")[2]
        where = f"{str(path).rpartition('#')[2]}: " if path else ""
        found.append(f"{where}{message} ({component})")
    return sorted(found)


def _from_rdflib(report: rdflib.Graph, request_iri: str) -> list[Triple]:
    # Messages name the focus node as well, so it is renamed in the text and not term by term.
    text = report.serialize(format="nt").replace(_FOCUS.value, request_iri)
    labels: dict[str, BlankNode] = {}

    def relabel(term: object) -> object:
        return labels.setdefault(term.value, BlankNode(f"r{len(labels)}")) if isinstance(term, BlankNode) else term

    quads = parse(text, format=RdfFormat.N_TRIPLES)
    return [Triple(relabel(q.subject), q.predicate, relabel(q.object)) for q in quads]  # type: ignore[arg-type]
