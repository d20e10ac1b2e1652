"""The page of a component: values, actions with their forms, and events."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from pyoxigraph import NamedNode

from linked_fleet_gateway.extensions.components.terms import LF
from linked_fleet_gateway.extensions.pages.languages import message
from linked_fleet_gateway.extensions.pages.thing_views import PRESENCE, Card, actions, cards, path_below, presence
from linked_fleet_gateway.extensions.pages.values import Facts
from linked_fleet_gateway.extensions.pages.views import PageView, Part
from linked_fleet_rdf.vocabulary import DCTERMS, HYBRIT, RDFS


def component(facts: Facts, iri: NamedNode) -> Part:
    title = facts.text(iri, DCTERMS.title)
    found = [(each, _named(facts, each, card, title)) for each, card in cards(facts, iri)]
    listed = {each for each, _ in found}
    leading = {predicate for predicate, values in facts.of.get(iri, {}).items() if listed.issuperset(values)}
    more = {
        "presence": presence(facts, iri),
        "comment": facts.spoken(iri, RDFS.comment),
        "fault": facts.text(iri, LF.fault),
        "told": [card for each, card in found if not facts.is_a(each, LF.ComponentEvent)],
        "events": [card for each, card in found if facts.is_a(each, LF.ComponentEvent)],
        "actions": actions(facts, iri),
        "stick": _by_hand(facts, iri, LF.extended("Base").Base, "drive"),
        "jog": _by_hand(facts, iri, LF.extended("Jogging").Jogging, "jogJoints"),
    }
    shown = {*PRESENCE, RDFS.comment, HYBRIT.property, HYBRIT.action, *leading}
    return Part(more, shown, set(listed))


def _by_hand(facts: Facts, iri: NamedNode, kind: NamedNode, name: str) -> Mapping[str, str]:
    """Return the addresses for moving a component of this kind by hand; nothing for another one."""
    action = NamedNode(f"{iri.value}/actions/{name}")
    if not facts.is_a(iri, kind) or action not in facts.all(iri, HYBRIT.action):
        return {}
    component = path_below(iri.value, facts.root)
    robot = component.rpartition("/")[0]
    return {"action": path_below(action.value, facts.root), "component": component, "robot": f"{robot}/"}


def _named(facts: Facts, iri: NamedNode, card: Card, title: str) -> Card:
    """Return a card under the title of its property, without the name of the component."""
    name = facts.text(iri, DCTERMS.title).removesuffix(f" of {title}")
    return replace(card, name=name, link=replace(card.link, text=name))


VIEW = PageView(
    LF.Component,
    Path(__file__).parent / "templates" / "component.html",
    component,
    help=message(
        "One part of the robot besides joints and links, such as a gripper or a base: its values, and what it can do."
    ),
    guide="docs/COMPONENTS.md",
)
