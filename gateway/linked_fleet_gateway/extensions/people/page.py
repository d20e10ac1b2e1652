"""The page of people."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from pyoxigraph import BlankNode, NamedNode

from linked_fleet_gateway.api import DCTERMS
from linked_fleet_gateway.extensions.pages.api import Facts, Link, PageView, Part, Value
from linked_fleet_gateway.extensions.pages.languages import message
from linked_fleet_gateway.extensions.people.terms import LF


@dataclass(frozen=True)
class Person:
    """Somebody who is here, or has control."""

    name: str
    since: Value | None
    robots: Sequence[Link]


def people(facts: Facts, iri: NamedNode) -> Part:
    nodes = [each for each in facts.all(iri, LF.people) if isinstance(each, BlankNode)]
    found = [
        Person(
            facts.text(each, DCTERMS.title),
            facts.first_value(each, LF.hereSince),
            [facts.placed_link(robot) for robot in facts.nodes(each, LF.controls)],
        )
        for each in nodes
    ]
    return Part({"people": sorted(found, key=lambda each: each.name)}, {LF.people}, {*nodes})


VIEW = PageView(
    LF.People,
    Path(__file__).parent / "templates" / "people.html",
    people,
    help=message("Who uses this fleet at present, and who has control of which robot."),
    guide="docs/IDENTITIES.md",
)
