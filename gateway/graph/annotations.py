"""Free-form Turtle that an agent adds to its description (R1.12), bounded and kept from posing as the gateway."""

import logging
from functools import lru_cache

from pyoxigraph import BlankNode, NamedNode, Triple

from gateway.graph.build import Graph
from gateway.graph.serialise import ParseError, parse
from gateway.graph.vocab import DCTERMS, HYBRIT, LDP, LF, RDF, ROS, SH, SOSA, XHV

log = logging.getLogger(__name__)

# What these namespaces say of a robot is the gateway's to say: an annotation must not add an action or a value.
_OWN = tuple(namespace.iri for namespace in (HYBRIT, LDP, LF, ROS, SH, SOSA, XHV))
# But a robot may say which poses it knows by name.
_ITS = frozenset({LF.namedPose, LF.target, LF.ofJoint})
_OWN_TERMS = frozenset({DCTERMS.title, DCTERMS.identifier, DCTERMS.hasPart})


def annotate(graph: Graph, subject: NamedNode, turtle: str, base: str) -> None:
    """Add the annotations about ``subject``, with the blank nodes below it; ``base`` is the robot's IRI."""
    by_subject = _parse(turtle, base)
    pending: list[NamedNode | BlankNode] = [subject]
    done: set[NamedNode | BlankNode] = set()
    while pending:
        node = pending.pop()
        if node in done:  # referred to more than once
            continue
        done.add(node)
        for triple in by_subject.get(node, ()):
            graph.add(triple.subject, triple.predicate, triple.object)  # type: ignore[arg-type]
            if isinstance(triple.object, BlankNode) and triple.object not in done:
                pending.append(triple.object)


@lru_cache(maxsize=256)
def _parse(turtle: str, base: str) -> dict[NamedNode | BlankNode, list[Triple]]:
    try:
        triples = parse(turtle.encode(), "text/turtle", base)
    except ParseError as error:
        log.warning("annotations of %s are left out: %s", base, error)
        return {}
    found: dict[NamedNode | BlankNode, list[Triple]] = {}
    for triple in triples:
        if is_own(triple):
            log.warning("annotation %s of %s is left out: the gateway alone states it", triple.predicate.value, base)
            continue
        found.setdefault(triple.subject, []).append(triple)  # type: ignore[arg-type]
    return found


def is_own(triple: Triple) -> bool:
    """A statement with a term of the gateway, a type of its vocabularies, or a second name for what it has named."""
    if triple.predicate == RDF.type:
        return isinstance(triple.object, NamedNode) and triple.object.value.startswith(_OWN)
    named = isinstance(triple.subject, NamedNode)  # a blank node may have a title
    if triple.predicate in _ITS:
        return False
    return triple.predicate.value.startswith(_OWN) or (named and triple.predicate in _OWN_TERMS)
