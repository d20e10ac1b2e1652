"""The view of the fleet: a card for each robot, and the filters for cards."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

from pyoxigraph import NamedNode

from linked_fleet_gateway.extensions.pages import labels, sentences
from linked_fleet_gateway.extensions.pages.resources import THUMBNAIL
from linked_fleet_gateway.extensions.pages.terms import LF
from linked_fleet_gateway.extensions.pages.thing_views import Presence, actions, path_below, presence
from linked_fleet_gateway.extensions.pages.values import Facts, Link, Time
from linked_fleet_gateway.extensions.pages.views import Part, constant
from linked_fleet_gateway.rdf.vocabulary import DCTERMS, HYBRIT, LDP

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
        labels.place(iri.value, facts.root),
        facts.text(iri, LF.modelName),
        presence(facts, iri),
        sentences.task(tasks[0], facts.root) if tasks else "",
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
