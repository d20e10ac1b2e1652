"""The pages of recordings: those of a robot, and one of them."""

from dataclasses import dataclass
from pathlib import Path

from pyoxigraph import NamedNode

from linked_fleet_gateway.api import DCTERMS, LDP, RDFS
from linked_fleet_gateway.extensions.pages.api import Facts, Link, PageView, Part, Value, timeline_link
from linked_fleet_gateway.extensions.pages.languages import message
from linked_fleet_gateway.extensions.recordings.resources import RECORDING, RECORDING_LIST
from linked_fleet_rdf.vocabulary import LF, VOM

_TEMPLATES = Path(__file__).parent / "templates"
_SHOWN = {DCTERMS.created, DCTERMS.description, DCTERMS.format, LF.duration, LF.byteSize, LF.reason}


@dataclass(frozen=True)
class Row:
    """A recording. ``why`` says what happened, or why it cannot be read; ``timeline`` shows what else happened then."""

    link: Link
    when: Value | None
    why: str
    length: str
    size: str
    timeline: str
    created: str

    @property
    def file(self) -> str:
        """The address of the MCAP file."""
        return f"{self.link.href}?as=mcap"


def recordings(facts: Facts, iri: NamedNode) -> Part:
    members = facts.nodes(iri, LDP.contains)
    rows = [_row(facts, each) for each in reversed(members)]
    return Part({"rows": rows}, {LDP.contains, RDFS.seeAlso}, {*members})


def recording(facts: Facts, iri: NamedNode) -> Part:
    robots = [facts.place_link(each) for each in facts.nodes(iri, RDFS.seeAlso)]
    return Part({"row": _row(facts, iri), "robots": robots}, _SHOWN | {RDFS.seeAlso})


def _row(facts: Facts, iri: NamedNode) -> Row:
    length = facts.one(iri, LF.duration, VOM.numericalValue)
    size = facts.text(iri, LF.byteSize)
    return Row(
        facts.link(iri),
        facts.first_value(iri, DCTERMS.created),
        facts.text(iri, DCTERMS.description) or facts.text(iri, LF.reason),
        f"{float(length.value):.1f} s" if length is not None else "",
        f"{int(size) / 1e6:.2f} MB" if size else "",
        timeline_link(facts, facts.text(iri, DCTERMS.created)),
        facts.text(iri, DCTERMS.created),
    )


VIEWS = (
    PageView(
        RECORDING_LIST,
        _TEMPLATES / "recordings.html",
        recordings,
        help=message(
            "The last 30 s before a motion failed, was stopped, or a fault came: what the robot measured then,"
            " to find out why."
        ),
        guide="docs/FAULTS.md",
    ),
    PageView(
        RECORDING,
        _TEMPLATES / "recording.html",
        recording,
        help=message("What the robot measured around one incident. Download the file to look at it."),
        guide="docs/FAULTS.md",
    ),
)
