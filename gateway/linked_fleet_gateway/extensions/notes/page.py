"""The pages of notes: all of them, those of a robot, and one note."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from pyoxigraph import NamedNode

from linked_fleet_gateway.api import DCTERMS, LDP, RDFS
from linked_fleet_gateway.extensions.notes.terms import LF
from linked_fleet_gateway.extensions.pages.api import Facts, Link, PageView, Part, Value, timeline_link
from linked_fleet_gateway.extensions.pages.languages import message

_TEMPLATES = Path(__file__).parent / "templates"


@dataclass(frozen=True)
class Row:
    """A note in a list."""

    link: Link
    about: Link
    text: str
    by: str
    when: Value | None
    written: str


def _rows(facts: Facts, iri: NamedNode) -> Sequence[Row]:
    members = facts.nodes(iri, LDP.contains)
    return sorted((_row(facts, each) for each in members), key=lambda row: row.written, reverse=True)


def _row(facts: Facts, iri: NamedNode) -> Row:
    about = facts.one(iri, LF.noteAbout)
    return Row(
        facts.link(iri),
        facts.placed_link(about) if isinstance(about, NamedNode) else Link("", "", ""),
        facts.text(iri, LF.noteText),
        facts.text(iri, LF.writtenBy),
        facts.first_value(iri, DCTERMS.created),
        facts.text(iri, DCTERMS.created),
    )


def notes(facts: Facts, iri: NamedNode) -> Part:
    """Return the view of the container, or of the notes of a robot, about which the form writes another one."""
    rows = _rows(facts, iri)
    above = [each.value for each in facts.nodes(iri, RDFS.seeAlso)]
    robot = next((each for each in above if each != facts.root and each.endswith("/")), "")
    more = {"notes": rows, "robot": robot, "container": f"{facts.root}notes"}
    return Part(more, {LDP.contains}, {NamedNode(each.link.iri) for each in rows})


def note(facts: Facts, iri: NamedNode) -> Part:
    row = _row(facts, iri)
    more = {"note": row, "timeline": timeline_link(facts, row.written)}
    return Part(more, {LF.noteText, LF.noteAbout, LF.writtenBy, DCTERMS.created})


_HELP = message("What the next shift should know of robots and faults. Who wrote a note may change or delete it.")
VIEWS = (
    PageView(LF.NoteList, _TEMPLATES / "note_list.html", notes, help=_HELP),
    PageView(LF.RobotNotes, _TEMPLATES / "robot_notes.html", notes, help=_HELP),
    PageView(LF.Note, _TEMPLATES / "note.html", note, help=message("One note, by whom and when it was written.")),
)
