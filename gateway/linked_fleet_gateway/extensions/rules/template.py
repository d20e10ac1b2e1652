"""The body of a rule's action: a template with terms in place of variables. Pure. Beside it the terms of rules.

Variables are replaced in RDF, not in text, so that no value can inject more than one term.
"""

from collections.abc import Iterable, Sequence

from pyoxigraph import BlankNode, Literal, NamedNode, RdfFormat, Triple, parse, serialize

from linked_fleet_base.errors import UnprocessableContent
from linked_fleet_gateway.extensions.rules.edges import Row
from linked_fleet_rdf.graph import Node
from linked_fleet_rdf.vocabulary import LF as CORE
from linked_fleet_rdf.vocabulary import PREFIXES

LF = CORE.extended(
    "Rule Firing RuleList FiringList RuleShape RuleResourceShape FiringShape disabled suppressed rules"
    " condition invokes body toldApartBy holdsFor enabled firings lastFiring causedBy suppressions variable"
    " binding invocation"
)

ROOT = BlankNode("body")
MOST_TRIPLES = 200


def template(triples: Sequence[Triple], root: BlankNode) -> str:
    """Return the triples of ``root`` and of the blank nodes below it, about ``ROOT``. Raises UnprocessableContent."""
    body = blank_node_closure(triples, [root])
    names: dict[object, BlankNode] = {root: ROOT}
    for each in body:
        if isinstance(each.object, BlankNode) and each.object not in names:
            names[each.object] = BlankNode(f"n{len(names)}")
    found = [Triple(names[each.subject], each.predicate, names.get(each.object, each.object)) for each in body]
    if len(found) > MOST_TRIPLES:
        raise UnprocessableContent(f"lf:body has {len(found)} triples; there may be {MOST_TRIPLES}.")
    for node, said in _holes(found).items():
        if said != 1 or node == ROOT or sum(each.subject == node for each in found) != 1:
            raise UnprocessableContent(
                'A node of lf:body with lf:variable has no other statements: [ lf:variable "name" ].'
            )
    written = serialize(found, format=RdfFormat.N_TRIPLES)
    assert written is not None  # None only when it writes to a file
    return written.decode()


def as_turtle(triples: Sequence[Triple], root: BlankNode) -> str:
    """Return the input of ``template`` for people: Turtle about ``_:body``, with the needed prefixes."""
    found = triples_of(template(triples, root))
    used = {term.value for each in found for term in (each.predicate, each.object) if isinstance(term, NamedNode)}
    prefixes = {name: iri for name, iri in PREFIXES.items() if any(each.startswith(iri) for each in used)}
    written = serialize(found, format=RdfFormat.TURTLE, prefixes=prefixes)
    assert written is not None  # nothing is written to a file
    return written.decode()


def blank_node_closure(triples: Sequence[Triple], roots: Iterable[object]) -> list[Triple]:
    """Return the triples about ``roots`` and about the blank nodes below them."""
    by_subject: dict[object, list[Triple]] = {}
    for each in triples:
        by_subject.setdefault(each.subject, []).append(each)
    pending = list(dict.fromkeys(roots))
    known, found = set(pending), []
    while pending:
        for each in by_subject.get(pending.pop(), ()):
            found.append(each)
            if isinstance(each.object, BlankNode) and each.object not in known:
                known.add(each.object)
                pending.append(each.object)
    return found


def triples_of(text: str) -> list[Triple]:
    return [quad.triple for quad in parse(text, format=RdfFormat.N_TRIPLES)]


def variables(text: str) -> set[str]:
    """Return the variables of a template."""
    return {each.object.value for each in triples_of(text) if each.predicate == LF.variable}  # type: ignore[union-attr]


def fill(text: str, row: Row, action: NamedNode) -> list[Triple]:
    """Return the body for ``action``. Raises UnprocessableContent for an unbound variable."""
    triples = triples_of(text)
    values: dict[object, Node | Literal] = {ROOT: action}
    for each in triples:
        if each.predicate == LF.variable:
            values[each.subject] = _bound(row, each.object.value)  # type: ignore[union-attr]
    return [
        Triple(values.get(each.subject, each.subject), each.predicate, values.get(each.object, each.object))  # type: ignore[arg-type]
        for each in triples
        if each.predicate != LF.variable
    ]


def _bound(row: Row, name: str) -> NamedNode | Literal:
    term = row.get(name)
    if term is None or isinstance(term, BlankNode):
        raise UnprocessableContent(f"?{name} is not bound to an IRI or a literal.")
    return term


def _holes(triples: Iterable[Triple]) -> dict[object, int]:
    """Return the number of variable names of each node that has any."""
    found: dict[object, int] = {}
    for each in triples:
        if each.predicate == LF.variable:
            found[each.subject] = found.get(each.subject, 0) + isinstance(each.object, Literal)
    return found
