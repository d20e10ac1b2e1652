"""The record of a board, and its statements."""

from msgspec import Struct

from linked_fleet_gateway.api import DCTERMS, Body, Graph, Member, UnprocessableContent, robot_of
from linked_fleet_gateway.extensions.boards.terms import LF


class Board(Struct, frozen=True, omit_defaults=True):
    """A board with ``lines``, which are the paths of properties, sorted.

    ``bases`` are those of their addresses in the body, until they are compared with that of the gateway.
    """

    title: str
    lines: tuple[str, ...]
    bases: tuple[str, ...] = ()

    @property
    def robots(self) -> frozenset[str]:
        """The robots whose values are shown: who may not see one of them does not see the board."""
        return frozenset(robot for each in self.lines if (robot := robot_of(each)))


def read_board(body: Body) -> Board:
    """Return what a body says. Raises UnprocessableContent."""
    title = (body.text(body.root, DCTERMS.title) or "").strip()
    if not title or not title.isprintable():
        raise UnprocessableContent("A board has a title of visible characters.")
    bases, lines = zip(*sorted(body.addresses(body.root, LF.boardLine)), strict=True)
    return Board(title, tuple(sorted(set(lines))), tuple(dict.fromkeys(bases)))


def describe_board(graph: Graph, member: Member[Board]) -> None:
    for each in member.record.lines:
        graph.add(member.iri, LF.boardLine, member.view.iri(each))
