"""The terms of notes."""

from linked_fleet_gateway.api import LF as CORE

LF = CORE.extended(
    "Note NoteList RobotNotes NoteInput NoteShape RobotNotesShape notes notesOfRobot noteText noteAbout writtenBy"
)
