"""The record of a note, and its statements."""

from msgspec import Struct

from linked_fleet_gateway.api import (
    DCTERMS,
    Body,
    Graph,
    Literal,
    Member,
    UnprocessableContent,
    timestamp,
)
from linked_fleet_gateway.extensions.notes.terms import LF

_TITLE = 80


class Note(Struct, frozen=True, omit_defaults=True):
    """A note about the thing at the path ``about``.

    ``robots`` are those whose readers alone may know of it. ``by`` is the name of who has written it, ``client`` the
    one by which requests of one are known. ``base`` is that of the address in the body, until it is compared with that
    of the gateway.
    """

    about: str
    text: str
    robots: tuple[str, ...] = ()
    by: str = ""
    client: str = ""
    written_ns: int = 0
    base: str = ""

    @property
    def title(self) -> str:
        """Its first line, if that is not long."""
        line = self.text.splitlines()[0]
        return line if len(line) <= _TITLE else line[: _TITLE - 1] + "…"


def read_note(body: Body) -> Note:
    """Return what a body says. Raises UnprocessableContent."""
    text = (body.text(body.root, LF.noteText) or "").strip()
    if not text or not all(each.isprintable() or each in "\n\t" for each in text):
        raise UnprocessableContent("A note has a text of visible characters and line breaks.")
    base, path = body.address(body.root, LF.noteAbout)
    if not path:
        raise UnprocessableContent(
            f"about is the address of a robot, of a part of one, or of a fault, not {base[:100]!r}."
        )
    return Note(path, text, base=base)


def describe_note(graph: Graph, member: Member[Note]) -> None:
    iri, note = member.iri, member.record
    graph.add(iri, LF.noteText, Literal(note.text))
    graph.add(iri, LF.noteAbout, member.view.iri(note.about))
    graph.add(iri, LF.writtenBy, Literal(note.by))
    graph.add(iri, DCTERMS.created, timestamp(note.written_ns))
