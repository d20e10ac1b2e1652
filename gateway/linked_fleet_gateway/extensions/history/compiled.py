"""Histories of single numbers by one template for each kind of them (``resources/templates.py``)."""

import math
from collections.abc import Sequence

from pyoxigraph import Literal, NamedNode

from linked_fleet_gateway.api import Property, robot_path
from linked_fleet_gateway.extensions.history.describe import (
    About,
    Page,
    describe_collection,
    describe_observation,
    describe_result,
    describe_robot,
    extent,
)
from linked_fleet_gateway.extensions.history.recorder import History
from linked_fleet_gateway.extensions.history.track import Series
from linked_fleet_gateway.faces import DescriptionTemplate, Rows, lexical_time
from linked_fleet_rdf.graph import Graph, lexical
from linked_fleet_rdf.vocabulary import XSD
from linked_fleet_state.robot import Robot

_COLON = "%3A"  # of times in queries


def history_template(
    base: str, of: str, item: Property, series: Series | None, page: Page
) -> DescriptionTemplate | None:
    """Return the kind of the history of the property at the path ``of``; None if it is described as usual.

    That is so without samples, and if a value is unknown.
    """
    if series is None or page.excerpt is None or page.time_range is None:
        return None
    texts = list[str]()
    for stamp_ns, numbers in series.samples(page.excerpt):
        if any(map(math.isnan, numbers)):
            return None
        texts += (lexical_time(stamp_ns), *map(lexical, numbers))
    width = 1 + len(series.columns)
    relation, query = page.adjacent
    start, *rest = query.split(_COLON)
    name, _, date = start.partition("=")
    last, _, limit = rest[-1].partition("&") if rest else ("", "", "")
    parts = [date, *rest[:-1], last] if rest else []
    unit = series.columns[0][1].qudt if width == 2 else None

    def describe(graph: Graph, owner: str, literals: Sequence[Literal]) -> None:
        title, oldest, newest, count, *others = literals
        link, samples = others[: len(parts)], others[len(parts) :]
        joined = _COLON.join(each.value for each in link)
        shown = f"{name}={joined}" + (f"&{limit}" if limit else "") if link else ""
        thing, robot = owner.rpartition("/")[0], "/" + owner.split("/")[1]
        iri = NamedNode(f"{base}{owner}/history")
        describe_collection(
            graph, iri, NamedNode(base + owner), NamedNode(base + (thing if thing != robot else robot + "/")),
            NamedNode(f"{base}{robot}/history"), About(title, (oldest, newest, count), relation, shown, unit),
        )  # fmt: skip
        for stamp, *terms in (samples[at : at + width] for at in range(0, len(samples), width)):
            describe_result(graph, describe_observation(graph, iri, stamp), item.shape, terms)

    def values() -> tuple[Literal, ...]:
        return Literal(f"History of {item.title}"), *_extent(page), *map(Literal, parts)

    key, rows = ("history", item.shape, unit, relation, name, limit), (XSD.dateTime, *(XSD.float,) * (width - 1))
    return DescriptionTemplate(key, of, describe, values, Rows(rows, texts))


def robot_history_template(
    base: str, robot: Robot, history: History, page: Page, parts: Sequence[str]
) -> DescriptionTemplate | None:
    """Return the kind of the history of a robot; None if it has no samples, or is not merely online."""
    if page.time_range is None or robot.presence != "online":
        return None
    path = robot_path(robot.name)

    def describe(graph: Graph, owner: str, literals: Sequence[Literal]) -> None:
        title, oldest, newest, count = literals
        describe_robot(graph, base, owner, robot, history, (title, (oldest, newest, count)), parts)

    def values() -> tuple[Literal, ...]:
        return Literal(f"History of {robot.name}"), *_extent(page)

    key = ("history of a robot", tuple(parts), tuple(history.findings))
    return DescriptionTemplate(key, path, describe, values)


def _extent(page: Page) -> tuple[Literal, Literal, Literal]:
    """Return the extent of a history with samples, whose times are known."""
    oldest, newest, count = extent(page)
    assert isinstance(oldest, Literal) and isinstance(newest, Literal)
    return oldest, newest, count
