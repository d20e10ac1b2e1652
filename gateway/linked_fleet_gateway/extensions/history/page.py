"""The pages of histories: the list, a chart of a robot's joints with its files, and a table of observations."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path

from pyoxigraph import Literal, NamedNode

from linked_fleet_gateway.extensions.history.describe import LF
from linked_fleet_gateway.extensions.pages import texts
from linked_fleet_gateway.extensions.pages.api import say
from linked_fleet_gateway.extensions.pages.languages import message
from linked_fleet_gateway.extensions.pages.thing_views import Presence, presence
from linked_fleet_gateway.extensions.pages.values import Facts, Link, Value
from linked_fleet_gateway.extensions.pages.views import PageView, Part
from linked_fleet_rdf.turtle import Term
from linked_fleet_rdf.vocabulary import DCTERMS, HYDRA, QUDT, RDFS, SOSA, VOM
from linked_fleet_rdf.vocabulary import LF as CORE

_TEMPLATES = Path(__file__).parent / "templates"
_MOST_MINUTES = 120


# -- the list -------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class HistoryRow:
    """The history of a robot, and its extent. ``length``: the time between its ends, empty if it is empty."""

    link: Link
    robot: Link
    presence: Presence
    length: str
    samples: str


def histories(facts: Facts, iri: NamedNode) -> Part:
    members = facts.nodes(iri, DCTERMS.hasPart)
    robots = [facts.one(each, LF.ofRobot) for each in members]
    listed = [_listed(facts, *each) for each in zip(members, robots, strict=True)]
    presences = sorted({each.presence.state.name for each in listed if each.presence.state})
    more = {
        "listed": listed,
        "choices": [("presence", say("Presence"), presences)],
        "findings": [each.value for each in facts.all(iri, CORE.fault) if isinstance(each, Literal)],
        "disk": _hours(facts, iri),
    }
    done = {*members, *(each for each in robots if isinstance(each, NamedNode))}
    return Part(more, {DCTERMS.hasPart, LF.historySpan, LF.diskSpan, CORE.fault, RDFS.seeAlso}, done)


def _listed(facts: Facts, iri: NamedNode, robot: Term | None) -> HistoryRow:
    assert isinstance(robot, NamedNode)  # the shape of the list
    link = Link(texts.place(robot.value, facts.root), iri.value, iri.value)
    length = _length(facts.text(iri, LF.oldestSample), facts.text(iri, LF.newestSample))
    return HistoryRow(link, facts.link(robot), presence(facts, robot), length, facts.text(iri, LF.sampleCount))


def _hours(facts: Facts, iri: NamedNode) -> str:
    """Return for how long samples are kept on disk, in words; empty if nothing is."""
    span = facts.one(iri, LF.diskSpan, VOM.numericalValue)
    return "" if span is None else f"{float(span.value) / 3600:.0f} h"


def _length(oldest: str, newest: str) -> str:
    """Return the time between two xsd:dateTime in words; empty if one is unknown."""
    if not oldest or not newest:
        return ""
    length = datetime.fromisoformat(newest) - datetime.fromisoformat(oldest)
    minutes, seconds = divmod(round(length.total_seconds()), 60)
    if minutes >= _MOST_MINUTES:
        return f"{minutes // 60} h {minutes % 60} min"
    return " ".join([f"{minutes} min", *([f"{seconds} s"] if seconds else [])]) if minutes else f"{seconds} s"


# -- one history ----------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class PartHistory:
    """The histories of the properties of a joint, a link or the robot itself. ``is_joint``: it has a velocity."""

    link: Link
    is_joint: bool
    histories: Sequence[Link]


@dataclass(frozen=True)
class ObservationRow:
    when: Value | None
    values: Sequence[Value]


def history(facts: Facts, iri: NamedNode) -> Part:
    robot = facts.one(iri, LF.ofRobot)
    shown = {HYDRA.search, HYDRA.view, HYDRA.next, HYDRA.previous, SOSA.hasMember, DCTERMS.hasPart, QUDT.unit}
    more = {
        "presence": Presence(None, None, ""),
        "state": "",
        "parts": list(_parts(facts, iri)),
        "spans": [Link(facts.text(each, DCTERMS.title), each.value, each.value) for each in _views(facts, iri)],
        "observed": [_observed(facts, each, facts.unit_of(iri)) for each in facts.all(iri, SOSA.hasMember)],
        "previous": facts.iri_of(iri, HYDRA.previous),
        "next": facts.iri_of(iri, HYDRA.next),
    }
    if isinstance(robot, NamedNode):
        more |= {"presence": presence(facts, robot), "state": facts.iri_of(robot, LF.jointState)}
    properties = {each for each in facts.of if isinstance(each, NamedNode) and each.value.startswith(facts.root)}
    nodes = {*facts.all(iri, HYDRA.search), *facts.all(iri, SOSA.hasMember)}
    title = say("History of {thing}", thing=texts.thing(iri.value.rpartition("/")[0], facts.root))
    return Part(more, shown, {*properties, *nodes} - {iri}, title)  # type: ignore[arg-type]


def _views(facts: Facts, iri: NamedNode) -> list[NamedNode]:
    return facts.nodes(iri, HYDRA.view)


def _parts(facts: Facts, iri: NamedNode) -> Iterator[PartHistory]:
    """Yield the histories in a robot's history by the part that owns the property."""
    by_owner: dict[str, list[Link]] = {}
    for each in facts.all(iri, DCTERMS.hasPart):
        if isinstance(each, NamedNode):
            of = each.value.rpartition("/")[0]
            owner, _, name = of.rpartition("/")
            by_owner.setdefault(owner, []).append(Link(texts.term_in_words(name), each.value, each.value))
    for owner, found in by_owner.items():
        own = len(texts.segments(owner, facts.root)) == 1
        address = owner + "/" if own else owner
        name = say("the robot itself") if own else texts.place(owner, facts.root)
        yield PartHistory(Link(name, address, address), any(each.text == "velocity" for each in found), found)


def _observed(facts: Facts, node: Term, unit: str) -> ObservationRow:
    simple = [facts.number(each, None, unit) for each in facts.all(node, SOSA.hasSimpleResult)]
    results = [*simple, *facts.values(node, SOSA.hasResult)]  # type: ignore[arg-type]
    return ObservationRow(facts.first_value(node, SOSA.resultTime), results)  # type: ignore[arg-type]


LIST = PageView(
    LF.HistoryList,
    _TEMPLATES / "histories.html",
    histories,
    {"history": "history"},
    help=message("What robots measured lately. Open one for charts, or download it as a file."),
    guide="docs/MAP.md",
)
HISTORY = PageView(
    LF.History,
    _TEMPLATES / "history.html",
    history,
    help=message("What was measured lately, as a chart and as files."),
    guide="docs/MAP.md",
)
