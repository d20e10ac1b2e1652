"""The pages of boards: all of them, and one."""

import re
from pathlib import Path
from urllib.parse import parse_qsl, urlencode

from pyoxigraph import NamedNode

from linked_fleet_gateway.api import LDP
from linked_fleet_gateway.extensions.boards.terms import LF
from linked_fleet_gateway.extensions.pages.api import Facts, PageView, Part
from linked_fleet_gateway.extensions.pages.languages import message

_TEMPLATES = Path(__file__).parent / "templates"
_TIME = re.compile(r"[0-9]{4}-[0-9]{2}-[0-9]{2}T[0-9:.]{8,18}Z", re.ASCII)


def boards(facts: Facts, iri: NamedNode) -> Part:
    members = facts.nodes(iri, LDP.contains)
    listed = sorted((facts.link(each) for each in members), key=lambda link: link.text.casefold())
    return Part({"boards": listed, "window": _window(facts.query)}, {LDP.contains}, set(members))


def _window(query: str) -> str:
    """Return the query that hands the times of a timeline on to boards; empty without both."""
    said = dict(parse_qsl(query[:1000], max_num_fields=20))
    found = {name: said[name] for name in ("from", "until") if _TIME.fullmatch(said.get(name, ""))}
    return "?" + urlencode(found) if len(found) == 2 else ""


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
