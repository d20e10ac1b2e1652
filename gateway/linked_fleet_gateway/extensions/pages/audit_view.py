"""The view of the audit: who did what, when, and with which outcome."""

from dataclasses import dataclass

from pyoxigraph import Literal, NamedNode

from linked_fleet_gateway.extensions.pages import labels, sentences
from linked_fleet_gateway.extensions.pages.values import Facts, Link, Value
from linked_fleet_gateway.extensions.pages.views import Part
from linked_fleet_gateway.rdf.vocabulary import DCTERMS, LDP, LF, PROV


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
    outcome, state = sentences.outcome(_status(facts, iri))
    made = facts.text(iri, DCTERMS.description)
    return Entry(
        created[0] if created else None,
        facts.text(agent, DCTERMS.title) if agent is not None else "",
        sentences.capital(sentences.done(what, path)),
        _link(path, facts),
        Link(labels.place(robot.value, facts.root), robot.value, robot.value) if isinstance(robot, NamedNode) else None,
        outcome,
        state,
        _link(made, facts) if made and state == "succeeded" else None,
    )


def _status(facts: Facts, iri: NamedNode) -> int | None:
    found = facts.one(iri, LF.status)
    return int(found.value) if isinstance(found, Literal) and found.value.isdecimal() else None


def _link(path: str, facts: Facts) -> Link:
    href = facts.root.rstrip("/") + path if path.startswith("/") else ""
    return Link(sentences.capital(sentences.thing(path, "/")), href, href)
