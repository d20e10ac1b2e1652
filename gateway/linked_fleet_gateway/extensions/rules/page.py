"""The pages of rules: a list with switches and an editor, one rule, and its firings."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from pyoxigraph import Literal, NamedNode

from linked_fleet_gateway.extensions.pages import labels, sentences
from linked_fleet_gateway.extensions.pages.values import Facts, Link, Value
from linked_fleet_gateway.extensions.pages.views import PageView, Part
from linked_fleet_gateway.extensions.rules.examples import EXAMPLES
from linked_fleet_gateway.rdf.vocabulary import DCTERMS, LDP, LF

_TEMPLATES = Path(__file__).parent / "templates"


@dataclass(frozen=True)
class Fired:
    """A firing in a table; ``did`` links its invocation while that exists."""

    link: Link
    when: Value | None
    state: Value | None
    reason: str
    did: Link | None
    bindings: Sequence[tuple[str, Value]]


@dataclass(frozen=True)
class Listed:
    """A rule in the list."""

    link: Link
    enabled: bool
    state: Value | None
    reasons: Sequence[str]
    last: Fired | None


def rules(facts: Facts, iri: NamedNode) -> Part:
    members = [each for each in facts.all(iri, LDP.contains) if isinstance(each, NamedNode)]
    firings = [each for member in members for each in facts.all(member, LF.lastFiring) if isinstance(each, NamedNode)]
    more = {"listed": [_listed(facts, each) for each in members], "examples": EXAMPLES}
    return Part(more, {LDP.contains, LDP.constrainedBy, LF.vocabulary}, {*members, *firings})


def rule(facts: Facts, iri: NamedNode) -> Part:
    """Show one rule; ``firings`` is the URL of the page of its firings."""
    more = {
        "enabled": _enabled(facts, iri),
        "state": _first(facts, iri, LF.state),
        "reasons": [each.value for each in facts.all(iri, LF.reason) if isinstance(each, Literal)],
        "condition": facts.text(iri, LF.condition),
        "firings": facts.iri_of(iri, LF.firings),
    }
    return Part(more, {LF.condition, LF.enabled, LF.state, LF.reason, LF.firings})


def firings(facts: Facts, iri: NamedNode) -> Part:
    members = [each for each in facts.all(iri, LDP.contains) if isinstance(each, NamedNode)]
    return Part({"fired": [_fired(facts, each) for each in members]}, {LDP.contains}, set(members))


def _listed(facts: Facts, iri: NamedNode) -> Listed:
    last = facts.one(iri, LF.lastFiring)
    return Listed(
        facts.link(iri),
        _enabled(facts, iri),
        _first(facts, iri, LF.state),
        [labels.clean(each.value) for each in facts.all(iri, LF.reason) if isinstance(each, Literal)],
        _fired(facts, last) if isinstance(last, NamedNode) else None,
    )


def _fired(facts: Facts, iri: NamedNode) -> Fired:
    invocation = facts.one(iri, LF.invocation)
    did = None
    if isinstance(invocation, NamedNode):
        text = sentences.capital(sentences.motion(invocation.value, facts.root, {}))
        did = Link(text, invocation.value, invocation.value)
    number = labels.local_name(iri.value)
    bindings = [
        (facts.text(node, LF.variable), value)
        for node in facts.all(iri, LF.binding)
        for value in facts.values(node, LF.value)  # type: ignore[arg-type]
    ]
    return Fired(
        Link(f"Firing {number}", iri.value, iri.value),
        _first(facts, iri, DCTERMS.created),
        _first(facts, iri, LF.state),
        facts.text(iri, LF.reason),
        did,
        bindings,
    )


def _enabled(facts: Facts, iri: NamedNode) -> bool:
    return facts.text(iri, LF.enabled) == "true"


def _first(facts: Facts, iri: NamedNode, predicate: NamedNode) -> Value | None:
    return next(iter(facts.values(iri, predicate)), None)


RULES = PageView(LF.RuleList, _TEMPLATES / "rules.html", rules)
RULE = PageView(LF.Rule, _TEMPLATES / "rule.html", rule)
FIRINGS = PageView(LF.FiringList, _TEMPLATES / "firings.html", firings)
