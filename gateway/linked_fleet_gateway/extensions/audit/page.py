"""The page of the audit: caller, request, time and outcome of each entry."""

from dataclasses import dataclass
from pathlib import Path

from linked_fleet_gateway.api import DCTERMS, LDP, Literal, NamedNode
from linked_fleet_gateway.extensions.audit.resources import LF
from linked_fleet_gateway.extensions.pages import texts
from linked_fleet_gateway.extensions.pages.api import Facts, Link, PageView, Part, Value
from linked_fleet_gateway.rdf.vocabulary import PROV


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
    outcome, state = _outcome(_status(facts, iri))
    made = facts.text(iri, DCTERMS.description)
    return Entry(
        created[0] if created else None,
        facts.text(agent, DCTERMS.title) if agent is not None else "",
        texts.capitalized(described(what, path)),
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


_DONE = {
    "PUT": "set",
    "POST": "add to",
    "PATCH": "change",
    "DELETE": "delete",
    "subscribe": "subscribe to",
    "unsubscribe": "end a subscription to",
    "stream": "open a stream to",
    "end stream": "end a stream to",
}


def described(what: str, path: str) -> str:
    """Describe an audited request in words; ``what`` is its method, or the event of a stream."""
    found = texts.segments(path, "/")
    if what == "RULE":
        return f"by a rule: {texts.task(path, '/')}"
    if "actions" in found[:-1] and what in ("PUT", "POST"):
        return texts.task(path, "/")
    if what == "DELETE" and "invocations" in found[:-1]:
        return f"stop {texts.task(path, '/')}"
    if what == "POST" and found[-1:] == ["subscriptions"]:
        return f"subscribe to {texts.thing('/'.join(found[:-1]), '/')}"
    return f"{_DONE.get(what, texts.term_in_words(what))} {texts.thing(path, '/')}"


def _outcome(status: int | None) -> tuple[str, str]:
    """Return the outcome of a request in words and as a state; ``status`` is None without a response."""
    if status is None:
        return "ended", "idle"
    if status < 400:
        return "done", "succeeded"
    return (f"refused ({status})", "cancelled") if status < 500 else (f"failed ({status})", "failed")


VIEW = PageView(LF.Audit, Path(__file__).parent / "templates" / "audit.html", audit)
