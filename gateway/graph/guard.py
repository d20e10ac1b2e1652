"""The guard of an action's body: pySHACL on the very shape that the action's description links (paper 5.4)."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import rdflib
from pyoxigraph import Literal, NamedNode, Triple

from gateway.errors import UnprocessableContent
from gateway.fleet.model import Joint
from gateway.graph.actions import branch, consumes, units
from gateway.graph.build import Graph
from gateway.graph.validation import FOCUS, check_lexical_forms, focused, from_rdflib, root, targeted, validate
from gateway.graph.vocab import VOM

_NO_BRANCH = re.compile(r"Node .*\(OrConstraintComponent\)", re.DOTALL)
# pySHACL writes Literal("59.98", datatype=xsd:decimal) in its messages; a person reads 59.98.
_LITERAL = re.compile(r'Literal\("([^"]*)"[^)]*\)')


@dataclass(frozen=True)
class Quantity:
    """What an admitted body says: a finite number and the IRI of its unit."""

    value: float
    unit: NamedNode


def admit(body: Sequence[Triple], joint: Joint, request_iri: str) -> Quantity:
    """Return the quantity in ``body``; UnprocessableContent with the validation report when the shape refuses it."""
    focus = root(body, NamedNode(request_iri))
    # What else a body says is nobody's business: not the shape's, nor rdflib's, which converts every literal. And two
    # values break a maxCount as well as a thousand, which would keep pySHACL busy for seconds.
    about = dict.fromkeys(t for t in body if t.subject == focus)
    body = [t for p in (VOM.numericalValue, VOM.unit) for t in [t for t in about if t.predicate == p][:2]]
    check_lexical_forms(body, request_iri)
    data = focused(body)
    conforms, report = validate(data, _guard(joint))
    if not conforms:
        raise _refusal(data, report, joint, request_iri)
    stated = {t.predicate: t.object for t in body}
    value, unit = stated[VOM.numericalValue], stated[VOM.unit]
    assert isinstance(value, Literal) and isinstance(unit, NamedNode)
    return Quantity(float(value.value), unit)


@lru_cache(maxsize=4096)
def _guard(joint: Joint) -> rdflib.Graph:
    graph = Graph()
    return targeted(graph, consumes(graph, joint))


@lru_cache(maxsize=4096)
def _branch(joint: Joint, index: int) -> rdflib.Graph:
    graph = Graph()
    return targeted(graph, branch(graph, joint, units(joint)[index]))


def _refusal(data: rdflib.Graph, report: rdflib.Graph, joint: Joint, request_iri: str) -> UnprocessableContent:
    """Name the constraint that failed: inside ``sh:or`` that of the branch of the unit that the body states."""
    messages = _messages(report)
    # Of the sh:or over the branches pySHACL says only that none holds; whatever else it says is more to the point.
    telling = [message for message in messages if not _NO_BRANCH.fullmatch(message)]
    stated = {str(o) for o in data.objects(rdflib.URIRef(FOCUS.value), rdflib.URIRef(VOM.unit.value))}
    for index, unit in enumerate(units(joint)):
        if not telling and stated & {i.value for i in unit.accepted}:
            conforms, inner = validate(data, _branch(joint, index))
            if not conforms:
                report, messages = inner, _messages(inner)
    detail = "The body does not conform to the shape of the action: " + "; ".join(
        _LITERAL.sub(r"\1", message.rpartition(" (")[0]).replace(f"<{FOCUS.value}>", "the body")
        for message in telling or messages
    )
    return UnprocessableContent(detail, report=from_rdflib(report, request_iri), constraint=request_iri)


def _messages(report: rdflib.Graph) -> list[str]:
    found = []
    for result in report.subjects(rdflib.SH.resultMessage):
        message = report.value(result, rdflib.SH.resultMessage)
        path = report.value(result, rdflib.SH.resultPath)
        component = str(report.value(result, rdflib.SH.sourceConstraintComponent)).rpartition("#")[2]
        where = f"{str(path).rpartition('#')[2]}: " if path else ""
        found.append(f"{where}{message} ({component})")
    return sorted(found)
