"""Rules and their firings as resources. Readers must see everything that the creator sees."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from decimal import Decimal
from typing import ClassVar

from pyoxigraph import BlankNode, Literal, NamedNode, RdfFormat, Triple, parse

from linked_fleet_gateway.api import CONTAINER as LDP_CONTAINER
from linked_fleet_gateway.api import FleetBranch, RequestView, Resource, Right, Source, blueprint_of
from linked_fleet_gateway.extensions.rules.request import CONTAINER
from linked_fleet_gateway.extensions.rules.rule import Firing, FiringState, Rule, RuleRecord
from linked_fleet_gateway.extensions.rules.template import LF, ROOT, triples_of
from linked_fleet_rdf.graph import Graph, Node, integer, timestamp
from linked_fleet_rdf.serialise import TEXT_TYPES
from linked_fleet_rdf.vocabulary import DCTERMS, HYBRIT, LDP, PROV, RDFS, XSD

_STATES = {
    FiringState.RUNNING: LF.running,
    FiringState.ACCEPTED: LF.accepted,
    FiringState.FAILED: LF.failed,
    FiringState.SUPPRESSED: LF.suppressed,
    FiringState.UNKNOWN: LF.unknown,
}


@dataclass(frozen=True)
class MakeRule:
    """Create a rule."""

    methods: ClassVar[tuple[str, ...]] = ("POST",)
    body_types: ClassVar[tuple[str, ...]] = TEXT_TYPES
    reads: ClassVar[bool] = False
    needs: ClassVar[tuple[Right, ...]] = (Right.SUBSCRIBE,)


@dataclass(frozen=True)
class ChangeRule:
    """Replace or delete a rule."""

    known: RuleRecord
    methods: ClassVar[tuple[str, ...]] = ("PUT", "DELETE")
    body_types: ClassVar[tuple[str, ...]] = TEXT_TYPES
    reads: ClassVar[bool] = False
    needs: ClassVar[tuple[Right, ...]] = (Right.SUBSCRIBE, Right.ADMIN)


def rule_path(rule: Rule) -> str:
    return f"{CONTAINER}/{rule.id}"


def firings_path(rule: Rule) -> str:
    return f"{rule_path(rule)}/firings"


def may_read(known: RuleRecord, view: RequestView) -> bool:
    """Return True if the caller created the rule, or sees all that its creator sees."""
    rule, sees = known.rule, view.visible_robots
    return sees.is_superset_of(rule.view) or (bool(sees.name) and sees.name == rule.creator)


def branch(rules: Mapping[str, RuleRecord]) -> FleetBranch:
    """Return the branch of rules; ``rules`` are the present rules by id."""

    def resolve(view: RequestView, rest: list[str]) -> Resource | None:
        if not rest:
            return _container(view, rules)
        known = rules.get(rest[0])
        if known is None or not may_read(known, view):
            return None
        return _in_rule(view, known, rules, rest[1:])

    return FleetBranch(CONTAINER[1:], LF.rules, resolve)


def _container(view: RequestView, rules: Mapping[str, RuleRecord]) -> Resource:
    def shown() -> list[RuleRecord]:
        return sorted((each for each in rules.values() if may_read(each, view)), key=lambda each: each.rule.created_ns)

    return Resource(
        CONTAINER,
        "Rules",
        lambda graph: _describe_container(graph, view, shown()),
        LDP_CONTAINER,
        Source(lambda: [_facts(each) for each in shown()]),
        own_paths=tuple(rule_path(each.rule) for each in shown()),
        affords=MakeRule(),
        has_form=True,
    )


def _facts(known: RuleRecord) -> tuple[object, ...]:
    return known.rule, known.suppressed, known.fault, known.suspended, known.begun, tuple(known.firings.items())[-1:]


def _in_rule(view: RequestView, known: RuleRecord, rules: Mapping[str, RuleRecord], rest: list[str]) -> Resource | None:
    rule = known.rule
    path, firings = rule_path(rule), firings_path(rule)
    if not rest or rest == ["blueprint"]:
        whole = Resource(
            path,
            rule.title,
            lambda graph: _describe_rule(graph, view, known),
            source=Source(lambda: _facts(known)),
            own_paths=(path + "/blueprint", firings),
            affords=ChangeRule(known),
            has_form=True,
        )
        return blueprint_of(whole, view.base, (LF.RuleResourceShape,)) if rest else whole
    if rest == ["firings"]:
        return Resource(
            firings,
            f"Firings of {rule.title}",
            lambda graph: _describe_firings(graph, view, known),
            LDP_CONTAINER,
            Source(lambda: tuple(known.firings.items())),
            own_paths=tuple(f"{firings}/{number}" for number in known.firings),
        )
    return _in_firing(view, known, rules, rest[1:]) if rest[0] == "firings" else None


def _in_firing(
    view: RequestView, known: RuleRecord, rules: Mapping[str, RuleRecord], rest: list[str]
) -> Resource | None:
    number = int(rest[0]) if rest[0].isdecimal() and rest[0].isascii() and len(rest[0]) < 16 else 0
    firing = known.firings.get(number)
    if firing is None or rest[0] != str(number) or rest[1:] not in ([], ["blueprint"]):
        return None
    path = f"{firings_path(known.rule)}/{number}"
    causes = [rule_path(rules[id].rule) for id in firing.causes if id in rules and may_read(rules[id], view)]
    whole = Resource(
        path,
        f"Firing {number} of {known.rule.title}",
        lambda graph: _describe_firing(graph, view, known.rule, number, firing, causes),
        source=Source(lambda: firing),
        own_paths=(path + "/blueprint",),
    )
    return blueprint_of(whole, view.base, (LF.FiringShape,)) if rest[1:] else whole


def _describe_container(graph: Graph, view: RequestView, rules: Iterable[RuleRecord]) -> None:
    iri = view.iri(CONTAINER)
    graph.a(iri, LF.RuleList, LDP.BasicContainer, LDP.Container)
    graph.add(iri, DCTERMS.title, Literal("Rules"))
    graph.add(iri, RDFS.seeAlso, view.iri("/"))
    # The shape's IRI need not lead to this gateway, so its document is linked as well.
    graph.add(iri, LDP.constrainedBy, LF.RuleShape)
    graph.add(iri, LF.vocabulary, view.iri("/vocabulary"))
    for known in rules:
        member = view.iri(rule_path(known.rule))
        graph.add(iri, LDP.contains, member)
        graph.a(member, LF.Rule)
        graph.add(member, DCTERMS.title, Literal(known.rule.title))
        graph.add(member, LF.state, rule_state(known))
        graph.add(member, LF.enabled, Literal(known.rule.enabled))
        graph.add(member, LF.reason, *map(Literal, _reasons(known)))
        if known.firings:
            number, firing = next(reversed(known.firings.items()))
            last = view.iri(f"{firings_path(known.rule)}/{number}")
            graph.add(member, LF.lastFiring, last)
            _summarise(graph, view, last, firing)


def _reasons(known: RuleRecord) -> list[str]:
    """Return the reasons why a rule is not evaluated, or not as it should be."""
    return [each for each in (known.rule.reason, known.suspended, known.fault) if each]


def _summarise(graph: Graph, view: RequestView, iri: NamedNode, firing: Firing) -> None:
    """Describe a firing in a list."""
    graph.a(iri, LF.Firing)
    graph.add(iri, DCTERMS.created, timestamp(firing.at_ns))
    graph.add(iri, LF.state, _STATES[firing.state])
    if firing.reason:
        graph.add(iri, LF.reason, Literal(firing.reason))
    # An invocation may be forgotten before its firing.
    if firing.invocation and view.invocations.get(firing.invocation.rpartition("/")[2]) is not None:
        graph.add(iri, LF.invocation, view.iri(firing.invocation))


def _describe_rule(graph: Graph, view: RequestView, known: RuleRecord) -> None:
    rule = known.rule
    iri = view.iri(rule_path(rule))
    graph.a(iri, LF.Rule)
    graph.add(iri, DCTERMS.title, Literal(rule.title))
    graph.add(iri, DCTERMS.identifier, Literal(rule.id))
    graph.add(iri, RDFS.seeAlso, view.iri(CONTAINER))
    graph.add(iri, HYBRIT.blueprint, LF.RuleResourceShape, NamedNode(iri.value + "/blueprint"))
    graph.add(iri, DCTERMS.created, timestamp(rule.created_ns))
    creator = graph.blank(PROV.Agent)
    graph.add(iri, PROV.wasAssociatedWith, creator)
    graph.add(creator, DCTERMS.title, Literal(rule.creator or rule.client))
    graph.add(iri, LF.condition, Literal(rule.condition))
    graph.add(iri, LF.invokes, _invoked(graph, rule))
    if rule.body:
        graph.add(iri, LF.body, _copied(graph, rule.body))
    graph.add(iri, LF.toldApartBy, *(Literal(name) for name in rule.told_apart_by))
    graph.add(iri, LF.minimumInterval, _decimal(rule.interval_s))
    graph.add(iri, LF.holdsFor, _decimal(rule.holds_for_s))
    graph.add(iri, LF.enabled, Literal(rule.enabled))
    graph.add(iri, LF.state, rule_state(known))
    graph.add(iri, LF.reason, *map(Literal, _reasons(known)))
    graph.add(iri, LF.suppressions, integer(known.suppressed))
    graph.add(iri, LF.firings, view.iri(firings_path(rule)))


def rule_state(known: RuleRecord) -> NamedNode:
    if not known.rule.enabled:
        return LF.disabled
    if known.suspended:
        return LF.suspended
    if known.fault:
        return LF.failing
    return LF.active if known.begun else LF.waiting


def _invoked(graph: Graph, rule: Rule) -> Node:
    if rule.variable is None:
        return NamedNode(rule.base + rule.invokes)
    node = graph.blank()
    graph.add(node, LF.variable, Literal(rule.variable))
    return node


def _copied(graph: Graph, body: str) -> Node:
    """Copy the template as written, with new blank node labels."""
    names: dict[BlankNode, BlankNode] = {}

    def own(term: object) -> object:
        if not isinstance(term, BlankNode):
            return term
        if term not in names:
            names[term] = graph.blank()
        return names[term]

    root = names[ROOT] = graph.blank()
    for triple in triples_of(body):
        graph.add(own(triple.subject), triple.predicate, own(triple.object))  # type: ignore[arg-type]
    return root


def _describe_firings(graph: Graph, view: RequestView, known: RuleRecord) -> None:
    iri = view.iri(firings_path(known.rule))
    graph.a(iri, LF.FiringList, LDP.BasicContainer, LDP.Container)
    graph.add(iri, DCTERMS.title, Literal(f"Firings of {known.rule.title}"))
    graph.add(iri, RDFS.seeAlso, view.iri(rule_path(known.rule)))
    for number, firing in reversed(known.firings.items()):
        member = NamedNode(f"{iri.value}/{number}")
        graph.add(iri, LDP.contains, member)
        _summarise(graph, view, member, firing)
        for name, term in sorted(firing.bindings.items()):
            node = graph.blank()
            graph.add(member, LF.binding, node)
            graph.add(node, LF.variable, Literal(name))
            graph.add(node, LF.value, _term(term))


def _describe_firing(
    graph: Graph, view: RequestView, rule: Rule, number: int, firing: Firing, causes: Iterable[str]
) -> None:
    iri = view.iri(f"{firings_path(rule)}/{number}")
    graph.a(iri, LF.Firing, PROV.Activity)
    graph.add(iri, DCTERMS.title, Literal(f"Firing {number} of {rule.title}"))
    graph.add(iri, DCTERMS.identifier, Literal(str(number)))
    graph.add(iri, RDFS.seeAlso, view.iri(firings_path(rule)), view.iri(rule_path(rule)))
    graph.add(iri, HYBRIT.blueprint, LF.FiringShape, NamedNode(iri.value + "/blueprint"))
    _summarise(graph, view, iri, firing)
    graph.add(iri, LF.causedBy, *map(view.iri, causes))
    for name, term in sorted(firing.bindings.items()):
        node = graph.blank()
        graph.add(iri, LF.binding, node)
        graph.add(node, LF.variable, Literal(name))
        graph.add(node, LF.value, _term(term))


def _term(text: str) -> Node | Literal:
    (quad,) = parse(f"<urn:firing> <urn:binds> {text} .", format=RdfFormat.N_TRIPLES)
    term: Node | Literal | Triple = quad.object
    assert not isinstance(term, Triple)  # bindings are no triples
    return term


def _decimal(value: float) -> Literal:
    text = f"{Decimal(repr(value)):f}"
    return Literal(text if "." in text else text + ".0", datatype=XSD.decimal)
