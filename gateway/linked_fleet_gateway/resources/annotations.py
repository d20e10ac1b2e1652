"""Annotations of a robot in any vocabulary (R1.12): a layer from its agent, and one from clients above it.

Neither layer can add statements reserved for the gateway, and clients cannot remove statements of the agent.
"""

import logging
from collections.abc import Iterable, Mapping, Sequence
from functools import lru_cache
from hashlib import blake2b

from pyoxigraph import BlankNode, NamedNode, Triple

from linked_fleet_gateway.fleet.robot import Annotations
from linked_fleet_gateway.rdf.graph import Graph, Node
from linked_fleet_gateway.rdf.serialise import ParseError, parse
from linked_fleet_gateway.rdf.unused import subjects
from linked_fleet_gateway.rdf.vocabulary import DCTERMS, HYBRIT, LDP, LF, RDF, ROS, SH, SOSA, XHV

log = logging.getLogger(__name__)

# Statements with these namespaces are reserved for the gateway: an annotation must not add an action or a value.
_OWN = tuple(namespace.iri for namespace in (HYBRIT, LDP, LF, ROS, SH, SOSA, XHV))
# Exceptions, with which a robot may name poses and give the charge of its battery.
_ITS = frozenset({LF.namedPose, LF.target, LF.ofJoint, LF.batteryCharge})
_OWN_TERMS = frozenset({DCTERMS.title, DCTERMS.identifier, DCTERMS.hasPart})
BySubject = Mapping[Node, Sequence[Triple]]


def annotate(graph: Graph, subject: NamedNode, said: Annotations, base: str) -> None:
    """Add the annotations about ``subject`` and the nodes that they describe; ``base`` is the robot's IRI."""
    for layer in _layers(said, base):
        for triple in about(layer, subject, base):
            graph.add(triple.subject, triple.predicate, triple.object)  # type: ignore[arg-type]


def about(layer: BySubject, subject: NamedNode, base: str) -> list[Triple]:
    """Return the triples about ``subject``, and about the blank nodes and external resources that these lead to.

    ``base`` is the IRI of a robot of the fleet.
    """
    inside = (base.removesuffix("/").rpartition("/")[0] + "/", *_OWN)
    found: list[Triple] = []
    pending: list[Node] = [subject]
    done: set[Node] = set()
    while pending:
        node = pending.pop()
        if node in done:  # referenced more than once
            continue
        done.add(node)
        for triple in layer.get(node, ()):
            found.append(triple)
            value = triple.object
            if isinstance(value, BlankNode) or (isinstance(value, NamedNode) and not value.value.startswith(inside)):
                pending.append(value)
    return found


def of_agent(said: Annotations, base: str) -> BySubject:
    """Return the agent's layer, which clients cannot change."""
    return _layers(said, base)[0]


def beyond(layer: BySubject, lower: BySubject) -> dict[Node, list[Triple]]:
    """Return ``layer`` without the statements that ``lower`` has too; blank nodes are compared by content."""
    mine, theirs = _meanings(layer), _meanings(lower)
    said = {_key(triple, theirs) for triples in lower.values() for triple in triples}
    return {
        node: [each for each in triples if isinstance(node, BlankNode) or _key(each, mine) not in said]
        for node, triples in layer.items()
    }


def _key(triple: Triple, meanings: Mapping[BlankNode, str]) -> tuple[str, ...]:
    return tuple(meanings[term] if isinstance(term, BlankNode) else str(term) for term in triple)


def _meanings(layer: BySubject) -> dict[BlankNode, str]:
    """Return a digest of the content of each blank node: equal for equal trees, unique for nodes in a cycle."""
    found: dict[BlankNode, str] = {}
    begun: set[BlankNode] = set()
    nodes = (term for triples in layer.values() for triple in triples for term in triple if isinstance(term, BlankNode))
    pending = list(dict.fromkeys(nodes))
    while pending:
        node = pending[-1]
        inner = [t.object for t in layer.get(node, ()) if isinstance(t.object, BlankNode) and t.object not in begun]
        if node not in begun:
            begun.add(node)
            pending += inner
            continue
        pending.pop()
        if node not in found:
            said = [(t.predicate.value, found.get(t.object, str(t.object))) for t in layer.get(node, ())]  # type: ignore[arg-type]
            found[node] = blake2b(repr(sorted(said)).encode(), digest_size=16).hexdigest()
    return found


@lru_cache(maxsize=256)
def _layers(said: Annotations, base: str) -> tuple[BySubject, BySubject]:
    """Return the layer of the agent, and the statements of clients beyond it."""
    agents, clients = (subjects(_parsed(text, base)) for text in said)
    return agents, beyond(clients, agents)


def _parsed(turtle: str, base: str) -> Iterable[Triple]:
    try:
        triples = parse(turtle.encode(), "text/turtle", base)
    except ParseError as error:
        log.warning("annotations of %s are left out: %s", base, error)
        return
    for triple in triples:
        if is_own(triple, base):
            log.warning("annotation %s of %s is left out: the gateway alone states it", triple.predicate.value, base)
        else:
            yield triple


def is_own(triple: Triple, base: str) -> bool:
    """Return True for a reserved statement: a gateway's term or type, or another title for a resource that it names.

    ``base`` is the IRI of the robot, below which the gateway names everything.
    """
    if triple.predicate == RDF.type:
        return isinstance(triple.object, NamedNode) and triple.object.value.startswith(_OWN)
    if triple.predicate in _ITS:
        return False
    named = isinstance(triple.subject, NamedNode) and triple.subject.value.startswith(base)
    return triple.predicate.value.startswith(_OWN) or (named and triple.predicate in _OWN_TERMS)
