"""Parsing of a rule in a request, checked by the published shape and against the fleet as its author sees it."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from functools import cache
from itertools import chain
from pathlib import Path

from pyoxigraph import BlankNode, Literal, NamedNode, Triple

from linked_fleet_base.errors import Statement, UnprocessableContent
from linked_fleet_gateway.extensions.rules.template import LF, blank_node_closure, template, variables
from linked_fleet_rdf.graph import Node
from linked_fleet_rdf.shapes import load_turtle_file
from linked_fleet_rdf.validation import (
    ShaclValidator,
    Terms,
    check_lexical_forms,
    check_root,
    find_root,
    refuse_statements,
    unused_statements,
)
from linked_fleet_rdf.vocabulary import DCTERMS, HYBRIT, PROV, RDF, RDFS

RULE_SHAPE = Path(__file__).with_name("rules.ttl")
"""The shape of a rule that is posted."""
CONTAINER = "/rules"
_SHOWN = (
    DCTERMS.identifier, DCTERMS.created, RDFS.seeAlso, HYBRIT.blueprint, PROV.wasAssociatedWith,
    LF.state, LF.reason, LF.firings, LF.suppressions,
)  # fmt: skip
"""Predicates of a rule's description that are ignored in a request, because the gateway maintains them."""
_OF_AUTHOR = (RDF.type, DCTERMS.title)
INTERVAL_S = 1.0
"""Default of the least time between two firings."""


@dataclass(frozen=True)
class RuleRequest:
    """The requested fields of ``Rule``; ``invokes`` is an IRI, or ``?`` and a variable."""

    title: str
    condition: str
    invokes: str
    body: str
    told_apart_by: tuple[str, ...]
    interval_s: float
    holds_for_s: float
    enabled: bool


def parse_rule(triples: Sequence[Triple], iri: str, base: str) -> RuleRequest:
    """Parse a rule from ``triples`` sent to ``iri``. Raises UnprocessableContent with the report of the shape."""
    container = base + CONTAINER
    focus = _focus(triples, iri)
    about = list(dict.fromkeys(each for each in triples if each.subject == focus))
    # Checked first, because a misspelt option would be ignored.
    refuse_statements(unused_statements(triples, focus, _terms(), _present(triples, focus)), container)
    check_lexical_forms(about, container)
    found = _validator().report(about, focus)
    if found is not None:
        detail, report = found
        raise _refusal(f"The body does not conform to the shape of a rule: {detail}", container, report)
    said: dict[NamedNode, list[Node | Literal]] = {}
    for each in about:
        said.setdefault(each.predicate, []).append(each.object)  # type: ignore[arg-type]
    return RuleRequest(
        title=_text(said, DCTERMS.title),
        condition=_text(said, LF.condition),
        invokes=_invoked(triples, said[LF.invokes][0], container),
        body=_body(triples, said.get(LF.body), container),
        told_apart_by=tuple(sorted({each.value for each in said.get(LF.toldApartBy, ())})),
        interval_s=float(_text(said, LF.minimumInterval) or INTERVAL_S) + 0.0,
        holds_for_s=float(_text(said, LF.holdsFor) or 0.0) + 0.0,
        enabled=_text(said, LF.enabled) in ("", "true", "1"),
    )


def _focus(triples: Sequence[Triple], iri: str) -> Node:
    """Return the only ``lf:Rule``, so that a description can be sent back; else the root of the body."""
    typed = list(dict.fromkeys(t.subject for t in triples if t.predicate == RDF.type and t.object == LF.Rule))
    target, creates = NamedNode(iri), iri.endswith(CONTAINER)
    if len(typed) == 1:
        return check_root(typed[0], target, creates_member=creates)  # type: ignore[arg-type]
    return find_root(triples, target, creates_member=creates)


def _present(triples: Sequence[Triple], focus: Node) -> frozenset[Triple]:
    """Return the permitted statements beside the rule: its body template, the action's variable, and its author."""
    nodes: dict[NamedNode, set[object]] = {LF.body: set(), LF.invokes: set(), PROV.wasAssociatedWith: set()}
    for each in triples:
        if each.subject == focus and each.predicate in nodes and isinstance(each.object, BlankNode):
            nodes[each.predicate].add(each.object)
    said = [each for each in triples if each.subject != focus]
    named = [each for each in said if each.subject in nodes[LF.invokes] and each.predicate == LF.variable]
    author = [each for each in said if each.subject in nodes[PROV.wasAssociatedWith] and each.predicate in _OF_AUTHOR]
    return frozenset([*blank_node_closure(said, nodes[LF.body]), *named, *author])


@cache
def _terms() -> Terms:
    """Return the terms of the shape and of a rule's description, which can be sent back unchanged."""
    return Terms.from_shapes(load_turtle_file(RULE_SHAPE), LF.RuleShape).with_terms(*_SHOWN)


def _text(said: dict[NamedNode, list[Node | Literal]], predicate: NamedNode) -> str:
    return said[predicate][0].value.strip() if predicate in said else ""


def _invoked(triples: Sequence[Triple], node: Node | Literal, container: str) -> str:
    if isinstance(node, NamedNode):
        return node.value
    names = [each.object for each in triples if each.subject == node and each.predicate == LF.variable]
    if len(names) != 1 or not isinstance(names[0], Literal):
        raise _refusal('lf:invokes is one action of the fleet, or [ lf:variable "name" ].', container)
    return f"?{names[0].value}"


def _body(triples: Sequence[Triple], found: list[Node | Literal] | None, container: str) -> str:
    if found is None:
        return ""
    assert isinstance(found[0], BlankNode)  # ensured by the shape
    try:
        return template(triples, found[0])
    except UnprocessableContent as error:
        raise _refusal(error.detail, container) from error


def check_variables(wanted: RuleRequest, selected: Collection[str], base: str) -> None:
    """Raise UnprocessableContent if the rule uses variables that its condition does not select."""
    used = variables(wanted.body) | set(wanted.told_apart_by)
    if wanted.invokes.startswith("?"):
        used.add(wanted.invokes[1:])
    if missing := sorted(used.difference(selected)):
        names = ", ".join(f"?{name[:50]}" for name in missing[:5])
        raise _refusal(f"lf:condition does not select {names}, which the rule uses.", base + CONTAINER)


@cache
def _validator() -> ShaclValidator:
    return ShaclValidator(chain.from_iterable(load_turtle_file(RULE_SHAPE).values()), LF.RuleShape)


def _refusal(detail: str, container: str, report: Sequence[Statement] | None = None) -> UnprocessableContent:
    return UnprocessableContent(detail, constraint=container, report=report)
