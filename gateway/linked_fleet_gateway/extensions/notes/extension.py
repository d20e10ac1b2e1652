"""The extension ``notes``: what people write down about robots, their parts and faults."""

import time
from collections.abc import AsyncIterator, Mapping, Sequence
from contextlib import asynccontextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, ClassVar

from msgspec.structs import replace

from linked_fleet_base.errors import InsufficientScope
from linked_fleet_base.settings import Section, setting, whole_number
from linked_fleet_gateway.api import (
    Body,
    Conflict,
    Container,
    Core,
    Extension,
    Mount,
    NavigationEntry,
    RequestView,
    Right,
    Robot,
    Table,
    UnprocessableContent,
    gauge,
    thing_at,
)
from linked_fleet_gateway.extensions.faults.extension import KnownFaults
from linked_fleet_gateway.extensions.notes.note import Note, describe_note, read_note
from linked_fleet_gateway.extensions.notes.of_robot import SEGMENT, notes_of_robots, notes_path
from linked_fleet_gateway.extensions.notes.operations import operations
from linked_fleet_gateway.extensions.notes.terms import LF
from linked_fleet_gateway.faces import Identity, Tree, View

HERE = Path(__file__).parent
MOST_OF_ROBOT = 500
_FAULTS = "/faults/"


@dataclass(frozen=True)
class NoteSettings(Section):
    prefix: ClassVar[str] = "LINKED_FLEET_NOTES_"

    most: int = setting(whole_number(1, 10_000), "5000", "notes of the fleet")


@dataclass(frozen=True)
class KnownNotes:
    """The service for other extensions that ask about notes."""

    known: Mapping[str, Note]

    def seen_by(self, sees: View) -> list[tuple[str, Note]]:
        """Return the notes that somebody who sees these robots may read."""
        return [(id, note) for id, note in list(self.known.items()) if _is_visible(note, sees)]


class NotesExtension(Extension):
    """Notes at ``/notes``, and those of one robot at ``/{robot}/notes``."""

    name = "notes"
    at_root = in_robot = (SEGMENT,)
    uses = ("faults",)
    vocabulary = (HERE / "vocabulary.ttl",)
    shapes = (HERE / "shapes.ttl",)
    settings = NoteSettings
    navigation = (NavigationEntry("Notes", f"/{SEGMENT}", 36),)

    def views(self) -> Sequence[object]:
        from linked_fleet_gateway.extensions.notes import page

        return page.VIEWS

    def operations(self, view: RequestView) -> Mapping[str, Mapping[str, Any]]:
        return operations(view)

    @asynccontextmanager
    async def start(self, core: Core) -> AsyncIterator[Mount]:
        faults = core.optional_service(KnownFaults)
        table = core.table(SEGMENT, Note, partial(_tell, core), core.section(NoteSettings).most)
        async with table:
            notes, known = _container(core.robots, faults, Notes(table)), table.known
            yield Mount(
                branches=(notes.branch, notes_of_robots(notes)),
                services=(KnownNotes(known),),
                metrics=lambda: [gauge("notes", "Notes of people about robots and faults.", len(known))],
            )


def _tell(core: Core, id: str, before: Note | None, after: Note | None) -> None:
    """Tell the subscribers of a note, of all notes, and of those of its robots."""
    if before is None:
        core.live.fan_out.add_resource(f"/{SEGMENT}/{id}")
    robots = {robot for each in (before, after) if each is not None for robot in each.robots}
    core.mark_changed(f"/{SEGMENT}/{id}", f"/{SEGMENT}", *map(notes_path, sorted(robots)))


class Notes:
    """The notes as the records of their container: a change keeps who has written a note, and when."""

    def __init__(self, table: Table[Note]) -> None:
        self._table, self.known = table, table.known

    async def add(self, record: Note) -> str:
        """Add a note and return its id. Raises Conflict, RedisUnavailable, ContainerFull."""
        for robot in record.robots:
            if sum(robot in each.robots for each in self.known.values()) >= MOST_OF_ROBOT:
                raise Conflict(f"There are {MOST_OF_ROBOT} notes about {robot}, which are the most. Delete some first.")
        return await self._table.add(record)

    async def change(self, id: str, record: Note | None) -> bool:
        """Replace the known note, or remove it for None. Return False if it has changed meanwhile."""
        held = self.known.get(id)
        if record is not None and held is not None:
            record = replace(record, by=held.by, client=held.client, written_ns=held.written_ns)
        return await self._table.change(id, record)


def _container(robots: Mapping[str, Robot], faults: KnownFaults | None, records: Notes) -> Container[Note]:
    return Container(
        segment=SEGMENT, title="Notes", type=LF.NoteList, member_type=LF.Note, records=records,
        shape=LF.NoteInput, read=partial(_read, robots, faults, records.known), describe=describe_note,
        title_of=lambda note: note.title, predicate=LF.notes, member_blueprint=LF.NoteShape,
        writing=(Right.ACT, Right.ADMIN), check=_check, owned=_is_own, signed=_signed, visible=_is_visible,
    )  # fmt: skip


def _read(robots: Mapping[str, Robot], faults: KnownFaults | None, known: Mapping[str, Note], body: Body) -> Note:
    """Return the note of a body, with the robots that it is about. Raises UnprocessableContent."""
    note = read_note(body)
    if (found := thing_at(note.about, robots)) is not None:
        return replace(note, robots=(found[0].name,))
    if faults is not None and note.about.startswith(_FAULTS):
        fault = faults.known.get(note.about.removeprefix(_FAULTS))
        if fault is not None:
            return replace(note, robots=fault.trouble.robots)
    # Notes about what has gone can be corrected.
    other = next((each for each in known.values() if each.about == note.about), None)
    if other is None:
        raise _nothing_there(note)
    return replace(note, robots=other.robots)


def _nothing_there(note: Note) -> UnprocessableContent:
    """Return the error for a thing that is not there, and for one that is hidden, which it must not tell apart."""
    return UnprocessableContent(f"There is no robot, part of one or fault at {(note.base + note.about)[:200]}.")


async def _check(note: Note, tree: Tree, caller: Identity) -> None:
    """Raise UnprocessableContent for a thing of another gateway, or one that is hidden from the caller;
    InsufficientScope without rights there.
    """
    if note.base != tree.view.base or not _is_visible(note, tree.view.visible_robots):
        raise _nothing_there(note)
    for robot in note.robots:
        if not (caller.has_right(Right.ACT, robot) or caller.has_right(Right.ADMIN, robot)):
            raise InsufficientScope(f"A note about {robot} takes the right to act there.", scope=Right.ACT)


def _is_visible(note: Note, sees: View) -> bool:
    return all(map(sees.includes, note.robots))


def _is_own(note: Note, caller: Identity, client: str) -> bool:
    """Return True for who has written a note, and for who administers its robots: all, if it is about none."""
    return note.client == client or all(caller.has_right(Right.ADMIN, each) for each in note.robots or (None,))


def _signed(note: Note, caller: Identity, client: str) -> Note:
    return replace(note, base="", by=caller.name or client, client=client, written_ns=time.time_ns())
