"""The page of the audit: a form that selects entries; caller, request, time, outcome and reason of each."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import parse_qsl

from linked_fleet_gateway.api import DCTERMS, LDP, RDFS, Literal, NamedNode
from linked_fleet_gateway.extensions.audit.describing import LF, PATH
from linked_fleet_gateway.extensions.pages import texts
from linked_fleet_gateway.extensions.pages.api import (
    Facts,
    Link,
    PageView,
    Part,
    Value,
    message,
    say,
    timeline_link,
    translated,
)
from linked_fleet_rdf.vocabulary import PROV, XHV

OUTCOMES = (("", "any"), ("succeeded", "done"), ("refused", "refused"), ("failed", "failed"), ("ended", "ended"))
"""Values of the parameter ``outcome``, in words."""


@dataclass(frozen=True)
class Entry:
    """A line of the audit. ``state`` colours the outcome; ``result`` links what was created.

    ``target`` and ``result`` have no address if there is no such resource any more. ``moment`` is the address of its
    time in the timeline.
    """

    id: str
    when: Value | None
    moment: str
    who: str
    what: str
    target: Link
    robot: Link | None
    outcome: str
    state: str
    reason: str
    result: Link | None
    by_page: bool


def audit(facts: Facts, iri: NamedNode) -> Part:
    members = facts.nodes(iri, LDP.contains)
    entries = [_entry(facts, each) for each in members]
    query = dict(parse_qsl(facts.text(iri, LF.filter)))
    older = facts.iri_of(iri, XHV.next)
    more = {
        "entries": entries,
        "query": query,
        "outcomes": OUTCOMES,
        "known": {"who": _known(each.who for each in entries), "robot": _known(_robots(entries))},
        "newest": facts.text(iri, LF.newestEntry),
        "older": older,
        "address": facts.root.rstrip("/") + PATH,
    }
    return Part(more, {LDP.contains, LF.filter, LF.newestEntry, RDFS.seeAlso}, set(members))


def _robots(entries: Iterable[Entry]) -> Iterator[str]:
    return (each.robot.text for each in entries if each.robot)


def _known(texts: Iterable[str]) -> list[str]:
    return sorted({each for each in texts if each})


def _entry(facts: Facts, iri: NamedNode) -> Entry:
    what, _, path = facts.text(iri, DCTERMS.title).partition(" ")
    agent = facts.one(iri, PROV.wasAssociatedWith)
    robot = facts.one(iri, LF.ofRobot)
    outcome, state = _outcome(_status(facts, iri))
    made = facts.text(iri, DCTERMS.description)
    return Entry(
        iri.value.partition("#")[2],
        facts.first_value(iri, DCTERMS.created),
        timeline_link(facts, facts.text(iri, DCTERMS.created)),
        facts.text(agent, DCTERMS.title) if agent is not None else "",
        texts.capitalized(described(what, path)),
        _link(path, facts.iri_of(iri, PROV.used)),
        facts.place_link(robot) if isinstance(robot, NamedNode) else None,
        outcome,
        state,
        facts.text(iri, LF.reason),
        _link(made, facts.iri_of(iri, PROV.generated)) if made and state == "succeeded" else None,
        facts.text(iri, LF.byPage) == "true",
    )


def _status(facts: Facts, iri: NamedNode) -> int | None:
    found = facts.one(iri, LF.status)
    return int(found.value) if isinstance(found, Literal) and found.value.isdecimal() else None


def _link(path: str, href: str) -> Link:
    return Link(texts.capitalized(texts.thing(path, "/")), href, path)


_DONE = {
    "PUT": message("set {thing}"),
    "POST": message("add to {thing}"),
    "PATCH": message("change {thing}"),
    "DELETE": message("delete {thing}"),
    "subscribe": message("subscribe to {thing}"),
    "unsubscribe": message("end a subscription to {thing}"),
    "INVITATION": message("open {thing}"),
    "stream": message("open a stream to {thing}"),
    "end stream": message("end a stream to {thing}"),
}

_BY_EXTENSIONS = {"MISSION": message("take a step of a mission"), "ORDER": message("start an order of the queue")}


def described(what: str, path: str) -> str:
    """Describe an audited request in words; ``what`` is its method, or the event of a stream."""
    found = texts.segments(path, "/")
    if what in _BY_EXTENSIONS:
        return translated(_BY_EXTENSIONS[what])
    if what == "RULE":
        return say("by a rule: {action}", action=texts.task(path, "/"))
    if "actions" in found[:-1] and what in ("PUT", "POST"):
        return texts.task(path, "/")
    if what == "DELETE" and "invocations" in found[:-1]:
        return say("stop {action}", action=texts.task(path, "/"))
    if what == "POST" and found[-1:] == ["subscriptions"]:
        return say("subscribe to {thing}", thing=texts.thing("/".join(found[:-1]), "/"))
    if what in _DONE:
        return say(_DONE[what], thing=texts.thing(path, "/"))
    return f"{texts.term_in_words(what)} {texts.thing(path, '/')}"


def _outcome(status: int | None) -> tuple[str, str]:
    """Return the outcome of a request in words and as a state; ``status`` is None without a response."""
    if status is None:
        return say("ended"), "idle"
    if status < 400:
        return say("done"), "succeeded"
    if status < 500:
        return say("refused ({status})", status=status), "cancelled"
    return say("failed ({status})", status=status), "failed"


VIEW = PageView(
    LF.Audit,
    Path(__file__).parent / "templates" / "audit.html",
    audit,
    help=message(
        "Who asked for what, and what became of it. Use the filter to find an entry; each leads to the time around it."
    ),
    guide="docs/IDENTITIES.md",
)
