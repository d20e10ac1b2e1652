"""The pages of stop latches: all of them, and one."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from pyoxigraph import NamedNode

from linked_fleet_gateway.api import DCTERMS, LDP
from linked_fleet_gateway.extensions.latches.terms import LF
from linked_fleet_gateway.extensions.pages.api import Facts, Link, PageView, Part, Value, timeline_link
from linked_fleet_gateway.extensions.pages.languages import message

_TEMPLATES = Path(__file__).parent / "templates"


@dataclass(frozen=True)
class Row:
    """A latch in a list."""

    link: Link
    about: Link
    reason: str
    by: str
    when: Value | None
    since: str


def _row(facts: Facts, iri: NamedNode) -> Row:
    about = facts.one(iri, LF.latchAbout)
    return Row(
        facts.link(iri),
        facts.placed_link(about) if isinstance(about, NamedNode) else Link("", "", ""),
        facts.text(iri, LF.reason),
        facts.text(iri, LF.latchedBy),
        facts.first_value(iri, DCTERMS.created),
        facts.text(iri, DCTERMS.created),
    )


def latches(facts: Facts, iri: NamedNode) -> Part:
    members = facts.nodes(iri, LDP.contains)
    rows: Sequence[Row] = sorted((_row(facts, each) for each in members), key=lambda row: row.since, reverse=True)
    return Part({"latches": rows}, {LDP.contains}, {NamedNode(each.link.iri) for each in rows})


def latch(facts: Facts, iri: NamedNode) -> Part:
    row = _row(facts, iri)
    more = {"latch": row, "timeline": timeline_link(facts, row.since)}
    return Part(more, {LF.latchAbout, LF.latchedBy, LF.reason, DCTERMS.created})


_HELP = message("A stop holds until a person resets it: whatever asks for a motion meanwhile is refused.")
VIEWS = (
    PageView(LF.StopLatchList, _TEMPLATES / "latch_list.html", latches, help=_HELP),
    PageView(LF.StopLatch, _TEMPLATES / "latch.html", latch, help=_HELP),
)
