"""The extension ``boards``: saved charts of values of several robots."""

from collections.abc import AsyncIterator, Mapping, Sequence
from contextlib import asynccontextmanager
from functools import partial
from pathlib import Path

from msgspec.structs import replace

from linked_fleet_gateway.api import (
    Container,
    Core,
    Extension,
    Mount,
    NavigationEntry,
    Resource,
    Right,
    Table,
    UnprocessableContent,
    gauge,
    thing_at,
)
from linked_fleet_gateway.extensions.boards.board import Board, describe_board, read_board
from linked_fleet_gateway.extensions.boards.terms import LF
from linked_fleet_gateway.faces import Identity, Tree, View, properties_at
from linked_fleet_rdf.vocabulary import VOM

HERE = Path(__file__).parent
SEGMENT = "boards"
MOST = 1_000


class BoardsExtension(Extension):
    """Boards at ``/boards``."""

    name = "boards"
    at_root = (SEGMENT,)
    vocabulary = (HERE / "vocabulary.ttl",)
    shapes = (HERE / "shapes.ttl",)
    navigation = (NavigationEntry("Boards", f"/{SEGMENT}", 41),)

    def views(self) -> Sequence[object]:
        from linked_fleet_gateway.extensions.boards import page

        return page.VIEWS

    @asynccontextmanager
    async def start(self, core: Core) -> AsyncIterator[Mount]:
        async with core.open_container(SEGMENT, Board, _container, MOST) as boards:
            known = boards.records.known
            yield Mount(
                branches=(boards.branch,),
                metrics=lambda: [gauge("boards", "Saved charts of measured numbers.", len(known))],
            )


def _container(table: Table[Board]) -> Container[Board]:
    return Container(
        segment=SEGMENT, title="Boards", type=LF.BoardList, member_type=LF.Board, records=table,
        shape=LF.BoardInput, read=read_board, describe=describe_board, title_of=lambda board: board.title,
        predicate=LF.boards, member_blueprint=LF.BoardShape, writing=(Right.ACT, Right.ADMIN),
        check=partial(_check, table.known), signed=_without_bases, visible=_is_visible,
    )  # fmt: skip


async def _check(known: Mapping[str, Board], board: Board, tree: Tree, caller: Identity) -> None:
    """Raise UnprocessableContent for a line that shows no number, is hidden from the caller, or is of another gateway.

    Boards can be changed even if one of their robots is not there any more.
    """
    if any(each != tree.view.base for each in board.bases):
        raise UnprocessableContent(f"The lines of a board are properties of this fleet, below {tree.view.base}/.")
    kept = {line for each in known.values() if _is_visible(each, tree.view.visible_robots) for line in each.lines}
    for line in board.lines:
        if line not in kept and not _shows_number(tree, line):
            raise UnprocessableContent(
                f"{line[:200]} is no property with one measured number, such as /ur5/wrist_3_joint/rotation or the "
                "charge of a battery."
            )


def _shows_number(tree: Tree, path: str) -> bool:
    if not _is_measured(tree, path) or not isinstance(found := tree.resolve(path), Resource):
        return False
    graph, iri = found.full_graph(tree.view.base), tree.view.iri(path)
    scalars = {subject for subject, predicate, _ in graph.statements if predicate == VOM.numericalValue}
    return any(subject == iri and value in scalars for subject, _, value in graph.statements)


def _is_measured(tree: Tree, path: str) -> bool:
    """Return True for a measured property of a robot or a part of it. Other resources may be long to describe."""
    owner, _, segment = path.rpartition("/")
    found = thing_at(owner if owner.count("/") > 1 else owner + "/", tree.view.robots)
    properties = [] if found is None else properties_at(tree.view.base, *found)
    return any(each.segment == segment and each.is_measured for each in properties)


def _is_visible(board: Board, sees: View) -> bool:
    return all(map(sees.includes, board.robots))


def _without_bases(board: Board, caller: Identity, client: str) -> Board:
    return replace(board, bases=())
