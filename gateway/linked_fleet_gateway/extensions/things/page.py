"""The page of the directory: a table of things with links to their descriptions."""

from dataclasses import dataclass
from pathlib import Path

from pyoxigraph import NamedNode

from linked_fleet_gateway.extensions.pages import texts
from linked_fleet_gateway.extensions.pages.api import say
from linked_fleet_gateway.extensions.pages.languages import message
from linked_fleet_gateway.extensions.pages.values import Facts, Link
from linked_fleet_gateway.extensions.pages.views import PageView, Part
from linked_fleet_gateway.extensions.things.directory import LF
from linked_fleet_rdf.vocabulary import LDP


@dataclass(frozen=True)
class ListedThing:
    """A thing, its robot, and the URL of its Thing Description."""

    link: Link
    kind: str
    robot: str
    description: str


def directory(facts: Facts, iri: NamedNode) -> Part:
    members = facts.nodes(iri, LDP.contains)
    things = [_thing(facts, each) for each in members]
    choices = [
        ("kind", say("Kind"), sorted({each.kind for each in things})),
        ("robot", say("Robot"), sorted({each.robot for each in things if each.robot})),
    ]
    return Part({"things": things, "choices": choices}, {LDP.contains}, set(members))


def _thing(facts: Facts, iri: NamedNode) -> ListedThing:
    path = texts.segments(iri.value, facts.root)
    kinds = facts.types(iri)
    robot = texts.segment_name(path[0], 0) if path else ""
    return ListedThing(facts.link(iri), kinds[0].text if kinds else "", robot, iri.value + "?as=td")


VIEW = PageView(
    LF.Directory,
    Path(__file__).parent / "templates" / "directory.html",
    directory,
    help=message("All robots, joints and parts as a list, with descriptions for programs."),
    guide="docs/MAP.md",
)
