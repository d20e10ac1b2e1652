"""The pages of faults: the list, with what needs attention first, and one fault with its actions."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from pyoxigraph import BlankNode, NamedNode

from linked_fleet_gateway.api import DCTERMS, LDP
from linked_fleet_gateway.extensions.faults.terms import LF, STATES
from linked_fleet_gateway.extensions.pages.api import Facts, Link, PageView, Part, Value, timeline_link
from linked_fleet_gateway.extensions.pages.languages import message
from linked_fleet_rdf.vocabulary import HYBRIT, VOM

_TEMPLATES = Path(__file__).parent / "templates"
_STATES = (LF.faultConfirmed, LF.faultRaised, LF.faultAcknowledged, LF.faultCleared)
_SEVERITIES = (LF.critical, LF.error, LF.warning, LF.information)


@dataclass(frozen=True)
class FaultRow:
    """A fault in the list. ``acknowledge`` is the action that can be invoked now, empty if there is none."""

    link: Link
    about: Link | None
    severity: str
    state: str
    since: Value | None
    count: str
    by: str
    acknowledge: str


def faults(facts: Facts, iri: NamedNode) -> Part:
    members = facts.nodes(iri, LDP.contains)
    ordered = sorted(members, key=lambda each: facts.text(each, LF.lastRaised), reverse=True)
    ordered.sort(key=lambda each: _rank(facts, each))
    rows = [_row(facts, each) for each in ordered]
    opened = [row for row, each in zip(rows, ordered, strict=True) if not _has(facts, each, LF.faultCleared)]
    more = {"opened": opened, "cleared": rows[len(opened) :]}
    return Part(more, {LDP.contains}, {*members, *_values_of(facts, members)})


def _rank(facts: Facts, iri: NamedNode) -> tuple[int, int]:
    """Return the place of a fault: what nobody has acknowledged first, and of that the worst first."""
    state, severity = facts.one(iri, LF.state), facts.one(iri, LF.severity)
    return _place(_STATES, state), _place(_SEVERITIES, severity)


def _place(terms: Sequence[NamedNode], found: object) -> int:
    return next((number for number, each in enumerate(terms) if each == found), len(terms))


def _has(facts: Facts, iri: NamedNode, state: NamedNode) -> bool:
    return facts.one(iri, LF.state) == state


def _word(facts: Facts, iri: NamedNode, predicate: NamedNode) -> str:
    """Return a state or a severity in a word."""
    name = facts.iri_of(iri, predicate).rpartition("#")[2]
    return next((word for word, term in STATES.items() if term.value.endswith("#" + name)), name)


def _values_of(facts: Facts, members: Sequence[NamedNode]) -> list[BlankNode]:
    return [node for each in members for node in facts.all(each, LF.valuesThen) if isinstance(node, BlankNode)]


def _row(facts: Facts, iri: NamedNode) -> FaultRow:
    about = facts.one(iri, LF.about)
    can = _has(facts, iri, LF.faultConfirmed) or _has(facts, iri, LF.faultRaised)
    return FaultRow(
        facts.link(iri),
        facts.placed_link(about) if isinstance(about, NamedNode) else None,
        _word(facts, iri, LF.severity),
        _word(facts, iri, LF.state),
        facts.first_value(iri, LF.since),
        facts.text(iri, LF.count),
        facts.text(iri, LF.acknowledgedBy),
        f"{iri.value}/actions/acknowledge" if can else "",
    )


def fault(facts: Facts, iri: NamedNode) -> Part:
    actions = [facts.link(each) for each in facts.nodes(iri, HYBRIT.action)]
    nodes = [each for each in facts.all(iri, LF.valuesThen) if isinstance(each, BlankNode)]
    values = [(facts.text(each, DCTERMS.title), facts.text(each, VOM.numericalValue)) for each in nodes]
    around = timeline_link(facts, facts.text(iri, LF.since), facts.text(iri, LF.clearedAt))
    more = {
        "fault": _row(facts, iri),
        "values": values,
        "actions": actions,
        "timeline": around,
        "notes": _notes(facts, iri),
    }
    return Part(more, {LF.valuesThen, LF.severity, LF.state, HYBRIT.action}, {*nodes})


def _notes(facts: Facts, iri: NamedNode) -> str:
    """Return the address of the notes of the robot that a fault is about; empty if it is about none."""
    path = facts.iri_of(iri, LF.about).removeprefix(facts.root)
    robot, slash, _ = path.partition("/")
    return f"{facts.root}{robot}/notes" if slash else ""


VIEWS = (
    PageView(
        LF.FaultList,
        _TEMPLATES / "faults.html",
        faults,
        help=message(
            "What is wrong in this fleet. Acknowledge a fault to say that you care for it; it stays until its"
            " cause is gone."
        ),
        guide="docs/FAULTS.md",
    ),
    PageView(
        LF.Fault,
        _TEMPLATES / "fault.html",
        fault,
        help=message("One fault: since when it is there, what was measured then, and who has acknowledged it."),
        guide="docs/FAULTS.md",
    ),
)
