"""Views of the resources at the root: the fleet and the vocabulary.

The fleet has a card for each robot, and filters for cards. The vocabulary has an index of its terms by kind, each with
its label and comment.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

from pyoxigraph import BlankNode, Literal, NamedNode

from linked_fleet_gateway.extensions.pages import texts
from linked_fleet_gateway.extensions.pages.assets import THUMBNAIL
from linked_fleet_gateway.extensions.pages.thing_views import Presence, actions, path_below, presence
from linked_fleet_gateway.extensions.pages.values import Facts, Link, Time
from linked_fleet_gateway.extensions.pages.views import LF, Part, constant
from linked_fleet_gateway.rdf.vocabulary import DCTERMS, HYBRIT, LDP, OWL, PREFIXES, PROV, RDF, RDFS, SH, VOM, XSD

LOW_PERCENT = 20.0
"""Charge in percent below which a card says that the battery is low; also in `scripts/src/fleet.js`."""
_OUT_OF_SERVICE = NamedNode(f"{LF.iri}outOfService")
_PRESENCES = ("online", "faulty", "offline")


@dataclass(frozen=True)
class RobotCard:
    """A robot in the fleet's list.

    ``model``: its kind. ``task``: its current activity in words, empty if none. ``holder`` has control of it.
    ``out_of_service`` says why it is. ``battery``: the charge in percent, empty if unknown. ``thumbnail``: the path of
    its drawing.
    """

    link: Link
    name: str
    model: str
    presence: Presence
    task: str
    moving: bool
    moved: Time | None
    holder: str
    out_of_service: str
    battery: str
    thumbnail: str

    @property
    def low(self) -> bool:
        return bool(self.battery) and float(self.battery) < LOW_PERCENT


def fleet(facts: Facts, iri: NamedNode) -> Part:
    members = [each for each in facts.all(iri, LDP.contains) if isinstance(each, NamedNode)]
    robots = sorted((_card(facts, each) for each in members), key=_trouble)
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
    tasks = [each for each in facts.all(iri, LF.currentTask) if isinstance(each, NamedNode)]
    moved = facts.values(iri, LF.lastMoved)
    return RobotCard(
        facts.link(iri),
        texts.place(iri.value, facts.root),
        facts.text(iri, LF.modelName),
        presence(facts, iri),
        _doing(facts, tasks[0]) if tasks else "",
        facts.one(iri, LF.moving) == Literal("true", datatype=XSD.boolean),
        moved[0] if moved and isinstance(moved[0], Time) else None,
        _holder(facts, iri),
        facts.text(iri, _OUT_OF_SERVICE),
        _percent(facts.text(iri, LF.batteryCharge)),
        path_below(iri.value, facts.root) + THUMBNAIL,
    )


def _doing(facts: Facts, task: NamedNode) -> str:
    """Return what a robot does, how far it is, and for whom; as ``doing`` of `scripts/src/fleet.js`."""
    share, client = facts.one(task, LF.progress, VOM.numericalValue), facts.one(task, PROV.wasAssociatedWith)
    far = f" {100 * float(share.value):.0f} %" if isinstance(share, Literal) else ""
    who = facts.text(client, DCTERMS.title) if isinstance(client, BlankNode) else ""
    return texts.task(task.value, facts.root) + far + (f" for {who}" if who else "")


def _holder(facts: Facts, iri: NamedNode) -> str:
    holder = facts.one(iri, LF.lease, LF.holder)
    return texts.clean(holder.value) if isinstance(holder, Literal) else ""


def _trouble(card: RobotCard) -> int:
    """Return the place of a robot among the others: those with trouble come first. Scripts add what they know more."""
    state = card.presence.state
    return {"faulty": 0, "offline": 1}.get(state.name if state else "", 2)


def _percent(charge: str) -> str:
    """Return a charge without decimals; empty if it is empty."""
    return f"{float(charge):.0f}" if charge else ""


def _counts(robots: Sequence[RobotCard]) -> list[tuple[str, int]]:
    found = Counter(each.presence.state.name for each in robots if each.presence.state)
    return [(name, found[name]) for name in _PRESENCES if found[name]]


def _leads_on(facts: Facts, iri: NamedNode, predicate: NamedNode) -> bool:
    values = facts.all(iri, predicate)
    return all(isinstance(each, NamedNode) and each.value.startswith(facts.root) for each in values)


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
