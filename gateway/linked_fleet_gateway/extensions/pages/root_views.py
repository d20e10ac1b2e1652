"""Views of the resources at the root: the fleet, the audit and the vocabulary.

The fleet has a card for each robot, and filters for cards. The audit has caller, request, time and outcome of each
entry. The vocabulary has an index of its terms by kind, each with its label and comment.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

from pyoxigraph import Literal, NamedNode

from linked_fleet_gateway.extensions.pages import texts
from linked_fleet_gateway.extensions.pages.assets import THUMBNAIL
from linked_fleet_gateway.extensions.pages.thing_views import Presence, actions, path_below, presence
from linked_fleet_gateway.extensions.pages.values import Facts, Link, Time, Value
from linked_fleet_gateway.extensions.pages.views import LF, Part, constant
from linked_fleet_gateway.rdf.vocabulary import DCTERMS, HYBRIT, LDP, OWL, PREFIXES, PROV, RDF, RDFS, SH, XSD

LOW_PERCENT = 20.0
"""Charge in percent below which a card says that the battery is low; also in `scripts/src/fleet.js`."""
_PRESENCES = ("online", "faulty", "offline")


@dataclass(frozen=True)
class RobotCard:
    """A robot in the fleet's list.

    ``model``: its kind. ``task``: its current activity in words, empty if none. ``battery``: the charge in percent,
    empty if unknown. ``thumbnail``: the path of its drawing.
    """

    link: Link
    name: str
    model: str
    presence: Presence
    task: str
    moving: bool
    moved: Time | None
    battery: str
    thumbnail: str

    @property
    def low(self) -> bool:
        return bool(self.battery) and float(self.battery) < LOW_PERCENT


def fleet(facts: Facts, iri: NamedNode) -> Part:
    members = [each for each in facts.all(iri, LDP.contains) if isinstance(each, NamedNode)]
    robots = [_card(facts, each) for each in members]
    more = {
        "robots": robots,
        "counts": _counts(robots),
        "kinds": sorted({each.model for each in robots if each.model}),
        "actions": actions(facts, iri),
        "world": facts.iri_of(iri, LF.world),
        "objects": constant("objects"),
    }
    # The navigation links everything else of the fleet.
    linked = {each for each in facts.of.get(iri, {}) if _leads_on(facts, iri, each)} - {DCTERMS.title}
    return Part(more, {LDP.contains, HYBRIT.action, *linked}, set(members))


def _card(facts: Facts, iri: NamedNode) -> RobotCard:
    tasks = [each.value for each in facts.all(iri, LF.currentTask) if isinstance(each, NamedNode)]
    moved = facts.values(iri, LF.lastMoved)
    return RobotCard(
        facts.link(iri),
        texts.place(iri.value, facts.root),
        facts.text(iri, LF.modelName),
        presence(facts, iri),
        texts.task(tasks[0], facts.root) if tasks else "",
        facts.one(iri, LF.moving) == Literal("true", datatype=XSD.boolean),
        moved[0] if moved and isinstance(moved[0], Time) else None,
        _percent(facts.text(iri, LF.batteryCharge)),
        path_below(iri.value, facts.root) + THUMBNAIL,
    )


def _percent(charge: str) -> str:
    """Return a charge without decimals; empty if it is empty."""
    return f"{float(charge):.0f}" if charge else ""


def _counts(robots: Sequence[RobotCard]) -> list[tuple[str, int]]:
    found = Counter(each.presence.state.name for each in robots if each.presence.state)
    return [(name, found[name]) for name in _PRESENCES if found[name]]


def _leads_on(facts: Facts, iri: NamedNode, predicate: NamedNode) -> bool:
    values = facts.all(iri, predicate)
    return all(isinstance(each, NamedNode) and each.value.startswith(facts.root) for each in values)


@dataclass(frozen=True)
class Entry:
    """A line of the audit. ``state`` colours the outcome; ``result`` links what was created."""

    when: Value | None
    who: str
    what: str
    target: Link
    robot: Link | None
    outcome: str
    state: str
    result: Link | None


def audit(facts: Facts, iri: NamedNode) -> Part:
    members = [each for each in facts.all(iri, LDP.contains) if isinstance(each, NamedNode)]
    entries = [_entry(facts, each) for each in members]
    choices = [
        ("who", "Who", sorted({each.who for each in entries if each.who})),
        ("of-robot", "Robot", sorted({each.robot.text for each in entries if each.robot})),
        ("outcome", "Result", sorted({each.outcome for each in entries})),
    ]
    return Part({"entries": entries, "choices": choices}, {LDP.contains}, set(members))


def _entry(facts: Facts, iri: NamedNode) -> Entry:
    what, _, path = facts.text(iri, DCTERMS.title).partition(" ")
    agent = facts.one(iri, PROV.wasAssociatedWith)
    created = facts.values(iri, DCTERMS.created)
    robot = facts.one(iri, LF.ofRobot)
    outcome, state = texts.outcome(_status(facts, iri))
    made = facts.text(iri, DCTERMS.description)
    return Entry(
        created[0] if created else None,
        facts.text(agent, DCTERMS.title) if agent is not None else "",
        texts.capitalized(texts.audit_text(what, path)),
        _link(path, facts),
        Link(texts.place(robot.value, facts.root), robot.value, robot.value) if isinstance(robot, NamedNode) else None,
        outcome,
        state,
        _link(made, facts) if made and state == "succeeded" else None,
    )


def _status(facts: Facts, iri: NamedNode) -> int | None:
    found = facts.one(iri, LF.status)
    return int(found.value) if isinstance(found, Literal) and found.value.isdecimal() else None


def _link(path: str, facts: Facts) -> Link:
    href = facts.root.rstrip("/") + path if path.startswith("/") else ""
    return Link(texts.capitalized(texts.thing(path, "/")), href, href)


_PLAIN = frozenset({RDFS.Class, RDF.Property, SH.NodeShape, SH.PropertyShape})


@dataclass(frozen=True)
class TermRow:
    """A term. ``name``: as in data; ``kinds``: its classes and superclasses."""

    anchor: str
    name: str
    label: str
    comment: str
    kinds: Sequence[Link]


@dataclass(frozen=True)
class VocabularySection:
    mark: str
    title: str
    terms: Sequence[TermRow]


def vocabulary(facts: Facts, iri: NamedNode) -> Part:
    found: dict[str, list[TermRow]] = {"classes": [], "properties": [], "shapes": [], "values": []}
    for subject in facts.of:
        if isinstance(subject, NamedNode) and subject != iri and not facts.is_a(subject, OWL.Ontology):
            found[_section(facts, subject)].append(_row(facts, subject))
    titles = {"classes": "Classes", "properties": "Properties", "values": "Values and states", "shapes": "Shapes"}
    sections = [VocabularySection(mark, titles[mark], _sorted(found[mark])) for mark in titles if found[mark]]
    return Part({"sections": sections}, frozenset(), set(facts.of) - {iri}, facts.text(iri, DCTERMS.title))


def _section(facts: Facts, term: NamedNode) -> str:
    if facts.is_a(term, RDFS.Class):
        return "classes"
    if facts.is_a(term, RDF.Property):
        return "properties"
    return "shapes" if facts.is_a(term, SH.NodeShape, SH.PropertyShape) else "values"


def _row(facts: Facts, term: NamedNode) -> TermRow:
    parents = [each for each in facts.all(term, RDFS.subClassOf) if isinstance(each, NamedNode)]
    kinds = [
        *parents,
        *(each for each in facts.all(term, RDF.type) if isinstance(each, NamedNode) and each not in _PLAIN),
    ]
    return TermRow(
        term.value.removeprefix(LF.iri) if term.value.startswith(LF.iri) else "",
        _prefixed(term),
        facts.text(term, RDFS.label) or texts.term_in_words(term.value),
        texts.sentence(facts.text(term, RDFS.comment)),
        [facts.term(each) for each in kinds],
    )


def _prefixed(term: NamedNode) -> str:
    for prefix, iri in PREFIXES.items():
        if term.value.startswith(iri):
            return f"{prefix}:{term.value.removeprefix(iri)}"
    return term.value


def _sorted(terms: Sequence[TermRow]) -> list[TermRow]:
    return sorted(terms, key=lambda each: each.name.lower())
