"""The history of what components of a robot said: ``/{robot}/history/values``, read from disk."""

import asyncio
import csv
import io
import time
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial

from pyoxigraph import Literal

from linked_fleet_base.errors import BadRequest
from linked_fleet_gateway.api import (
    Found,
    Graph,
    NamedNode,
    Request,
    RequestView,
    Resource,
    Response,
    Robot,
    Source,
    blueprint_of,
    read_resource,
    robot_path,
)
from linked_fleet_gateway.extensions.history.describe import LF
from linked_fleet_gateway.extensions.history.files import CSV
from linked_fleet_gateway.extensions.history.recorder import History
from linked_fleet_gateway.extensions.history.segment import UNKNOWN, Said
from linked_fleet_gateway.extensions.history.sending import paced
from linked_fleet_gateway.extensions.history.shelf import Shelf
from linked_fleet_gateway.extensions.history.span import MOST, Span, lexical_duration, lexical_time, parse_span, query
from linked_fleet_gateway.extensions.history.track import LATEST_NS
from linked_fleet_gateway.serving import Rendition, check_preconditions
from linked_fleet_rdf.graph import timestamp
from linked_fleet_rdf.vocabulary import DCTERMS, HYBRIT, RDF, RDFS, SOSA

VALUES = "values"
_JSON = RDF.extended("JSON").JSON
_RECENT_NS = 300 * 10**9
"""The span up to now that a request without a time gets."""


@dataclass(frozen=True)
class RecordedValues:
    """The values of a robot; the query of the request selects a part of them."""

    history: History
    view: RequestView
    robot: Robot


def values_of(history: History, view: RequestView, robot: Robot, rest: list[str]) -> Found:
    """Return the values of a robot, or their blueprint."""
    path = f"{robot_path(robot.name)}history/{VALUES}"
    found = Resource(
        path, f"Values of {robot.name}", None, own_paths=(path + "/blueprint",), source=Source(robot=robot),
        remote=RecordedValues(history, view, robot),
    )  # fmt: skip
    if rest == ["blueprint"]:
        return blueprint_of(found, view.base, (LF.ComponentHistoryShape,))
    return None if rest else found


async def read_values(request: Request, found: Resource, recorded: RecordedValues) -> Response:
    """Return what components said in the requested time, or what held at an instant. Raises BadRequest, Busy."""
    given = request.query_params.multi_items()
    of = [value for name, value in given if name == "of"]
    span, archive = parse_span(each for each in given if each[0] != "of"), recorded.history.archive
    if len(of) > 1 or "" in of:
        raise BadRequest("of is one property, by its path below the robot, such as battery/charge.")
    if span.every_ns is not None and not of:
        raise BadRequest("Values of components are told when they change, so every has a meaning only beside of.")
    assert archive is not None  # else there is no such resource
    shelf, now_ns = archive.shelf, time.time_ns()

    def work() -> tuple[Response, int | None]:
        said, after = _selected(shelf, recorded.robot.name, span, now_ns, "".join(of))
        resource = _resource(recorded, found, said)
        check_preconditions(request, resource)
        return read_resource(request, resource), after

    async with recorded.history.worker():
        response, after = await asyncio.to_thread(work)
    return paced(response, recorded.history, request.base + found.path, {"next": _following(span, after, of)})


def _following(span: Span, after: int | None, of: Sequence[str]) -> str:
    """Return the query of the next page; empty if there is none."""
    if after is None:
        return ""
    end = {} if span.end_ns is None else {"to": lexical_time(span.end_ns)}
    limit = {} if span.limit is None else {"limit": span.limit}
    every = {} if span.every_ns is None else {"every": lexical_duration(span.every_ns)}
    return query(from_=lexical_time(after), **end, **limit, **every, **({"of": of[0]} if of else {}))


def _selected(shelf: Shelf, robot: str, span: Span, now_ns: int, of: str) -> tuple[Sequence[Said], int | None]:
    """Return what is requested, of the property at the path ``of`` if there is one, and where the rest begins; None if
    it is all.
    """
    if span.at_ns is not None:
        heard = shelf.at(robot, span.at_ns).frames
        held = shelf.values_at(robot, span.at_ns) if heard else {}
        return [held[path] for path in sorted(held) if held[path].json != UNKNOWN and of in ("", path)], None
    last_ns = span.last_ns if span.last_ns is not None else None if span.end_ns is not None else _RECENT_NS
    begin_ns = span.begin_ns if span.begin_ns is not None else 0 if last_ns is None else max(0, now_ns - last_ns)
    end_ns = LATEST_NS if span.end_ns is None else span.end_ns
    choose = partial(_spaced, span.every_ns) if span.every_ns else iter
    return shelf.values(robot, begin_ns, end_ns, min(span.limit or MOST, MOST), path=of, choose=choose)


def _spaced(every_ns: int, said: Iterable[Said]) -> Iterator[Said]:
    """Yield values of one property ``every_ns`` apart; where it becomes known or unknown is never left out."""
    last: Said | None = None
    for each in said:
        turns = last is None or (each.json == UNKNOWN) != (last.json == UNKNOWN)
        if turns or last is None or each.stamp_ns - last.stamp_ns >= every_ns:
            last = each
            yield each


def _resource(recorded: RecordedValues, found: Resource, said: Sequence[Said]) -> Resource:
    view, robot = recorded.view, recorded.robot

    def describe(graph: Graph) -> None:
        iri, root = view.iri(found.path), robot_path(robot.name)
        graph.a(iri, LF.ComponentHistory, SOSA.ObservationCollection)
        graph.add(iri, DCTERMS.title, Literal(found.title))
        graph.add(iri, HYBRIT.blueprint, LF.ComponentHistoryShape, NamedNode(iri.value + "/blueprint"))
        graph.add(iri, LF.ofRobot, view.iri(root))
        graph.add(iri, RDFS.seeAlso, view.iri(root + "history"))
        for each in said:
            one = graph.blank(SOSA.Observation)
            graph.add(iri, SOSA.hasMember, one)
            graph.add(one, SOSA.observedProperty, view.iri(root + each.path))
            graph.add(one, SOSA.resultTime, timestamp(each.stamp_ns))
            graph.add(one, SOSA.hasSimpleResult, Literal(each.json, datatype=_JSON))

    def table() -> bytes:
        text = io.StringIO(newline="")
        write = csv.writer(text, lineterminator="\r\n")
        write.writerow(["time", "path", "kind", "value"])
        write.writerows([lexical_time(each.stamp_ns), each.path, each.kind, each.json] for each in said)
        return text.getvalue().encode()

    documents = {CSV: Rendition(table, f"{robot.name}-values.csv")}
    return found.replace(describe=describe, documents=documents, publishes_changes=False)
