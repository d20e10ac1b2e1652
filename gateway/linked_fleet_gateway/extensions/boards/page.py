"""The pages of boards: all of them, and one."""

from pathlib import Path

from pyoxigraph import NamedNode

from linked_fleet_gateway.api import LDP
from linked_fleet_gateway.extensions.boards.terms import LF
from linked_fleet_gateway.extensions.pages.api import Facts, PageView, Part
from linked_fleet_gateway.extensions.pages.languages import message

_TEMPLATES = Path(__file__).parent / "templates"


def boards(facts: Facts, iri: NamedNode) -> Part:
    members = facts.nodes(iri, LDP.contains)
    listed = sorted((facts.link(each) for each in members), key=lambda link: link.text.casefold())
    return Part({"boards": listed}, {LDP.contains}, set(members))


def board(facts: Facts, iri: NamedNode) -> Part:
    lines = [facts.placed_link(each) for each in facts.nodes(iri, LF.boardLine)]
    return Part({"lines": lines}, {LF.boardLine})


VIEWS = (
    PageView(
        LF.BoardList, _TEMPLATES / "board_list.html", boards,
        help=message("Charts that you want to see again: numbers of any robots, those of one unit in one chart."),
    ),
    PageView(
        LF.Board, _TEMPLATES / "board.html", board,
        help=message("Drag over a chart to look closer, and double-click to go back to what is measured now."),
    ),
)  # fmt: skip
