"""The world as it was around a robot: ``/{robot}/history/world``, read from disk.

It has where robots stood and the objects that were there at an instant, described as the present ones are, and the time
for which that holds.
"""

import asyncio
import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from math import dist

from pyoxigraph import Literal, NamedNode

from linked_fleet_base.errors import BadRequest
from linked_fleet_gateway.api import (
    Found,
    Graph,
    Pose,
    Request,
    RequestView,
    Resource,
    Response,
    Robot,
    Source,
    blueprint_of,
    integer,
    read_resource,
    robot_path,
)
from linked_fleet_gateway.extensions.history.describe import LF
from linked_fleet_gateway.extensions.history.recorder import History
from linked_fleet_gateway.extensions.history.segment import PLACEMENTS, UNKNOWN, WORLD, Said
from linked_fleet_gateway.extensions.history.shelf import Shelf
from linked_fleet_gateway.extensions.history.span import Span, parse_span
from linked_fleet_gateway.extensions.history.track import LATEST_NS
from linked_fleet_gateway.extensions.history.world_watch import (
    BEGUN,
    OBJECTS,
    PastObject,
    read_kept,
)
from linked_fleet_gateway.extensions.models.geometry import model_path
from linked_fleet_gateway.extensions.world.descriptions import describe_object, describe_unreadable, object_path
from linked_fleet_gateway.extensions.world.placement import LF as WORLD_LF
from linked_fleet_gateway.extensions.world.placement import PLACEMENT, describe_pose
from linked_fleet_gateway.extensions.world.service import World as PresentWorld
from linked_fleet_gateway.serving import check_preconditions
from linked_fleet_rdf.graph import timestamp
from linked_fleet_rdf.vocabulary import DCTERMS, HYBRIT, LDP, RDFS
from linked_fleet_state.kinematics import ORIGIN

SEGMENT = "world"
MOST_ROBOTS = 100
"""Robots that are described, those that stood nearest."""


@dataclass(frozen=True)
class RecordedWorld:
    """The world around a robot; the query of the request selects the instant."""

    history: History
    present: PresentWorld
    view: RequestView
    robot: Robot


@dataclass(frozen=True)
class PastWorld:
    """The world as it was known at an instant, from ``begin_ns`` on and before ``end_ns``; None: it holds still."""

    begin_ns: int
    end_ns: int | None
    places: Mapping[str, Pose]
    objects: Mapping[str, PastObject]


def world_of(history: History, present: PresentWorld, view: RequestView, robot: Robot, rest: list[str]) -> Found:
    """Return the world around a robot, or its blueprint."""
    path = f"{robot_path(robot.name)}history/{SEGMENT}"
    found = Resource(
        path, f"The world around {robot.name}", None, own_paths=(path + "/blueprint",), source=Source(robot=robot),
        remote=RecordedWorld(history, present, view, robot),
    )  # fmt: skip
    if rest == ["blueprint"]:
        return blueprint_of(found, view.base, (LF.PastWorldShape,))
    return None if rest else found


async def read_world(request: Request, found: Resource, recorded: RecordedWorld) -> Response:
    """Return the world at the requested instant, at present without one. Raises BadRequest, Busy."""
    span, archive = parse_span(request.query_params.multi_items()), recorded.history.archive
    if span not in (Span(), Span(at_ns=span.at_ns)):
        raise BadRequest("The world as it was takes only the parameter at, the time of an instant.")
    assert archive is not None  # else there is no such resource
    shelf, at_ns = archive.shelf, time.time_ns() if span.at_ns is None else span.at_ns

    def work() -> Response:
        resource = _resource(recorded, found, past_world(shelf, at_ns))
        check_preconditions(request, resource)
        return read_resource(request, resource)

    async with recorded.history.worker():
        return await asyncio.to_thread(work)


def past_world(shelf: Shelf, at_ns: int) -> PastWorld | None:
    """Return what was known of the world at a time; None if nothing was written then."""
    found = shelf.world_at(at_ns)
    if (begun := found.pop(BEGUN, None)) is None:
        return None
    known = {path: each for path, each in found.items() if each.stamp_ns >= begun.stamp_ns}
    later, _ = shelf.values(WORLD, at_ns + 1, LATEST_NS, 1)
    begin_ns = max((each.stamp_ns for each in known.values()), default=begun.stamp_ns)
    there = {path: each for path, each in known.items() if each.json != UNKNOWN}
    return PastWorld(
        begin_ns,
        later[0].stamp_ns if later else None,
        {name: place for name, said in _below(PLACEMENTS, there) if (place := read_kept(said.json, Pose)) is not None},
        {id: read_kept(said.json, PastObject) or PastObject() for id, said in _below(OBJECTS, there)},
    )


def _below(prefix: str, said: Mapping[str, Said]) -> Iterator[tuple[str, Said]]:
    yield from ((path.removeprefix(prefix), each) for path, each in said.items() if path.startswith(prefix))


def _resource(recorded: RecordedWorld, found: Resource, past: PastWorld | None) -> Resource:
    view, robot = recorded.view, recorded.robot

    def describe(graph: Graph) -> None:
        iri = view.iri(found.path)
        graph.a(iri, LF.PastWorld)
        graph.add(iri, DCTERMS.title, Literal(found.title))
        graph.add(iri, HYBRIT.blueprint, LF.PastWorldShape, NamedNode(iri.value + "/blueprint"))
        graph.add(iri, LF.ofRobot, view.iri(robot_path(robot.name)))
        graph.add(iri, RDFS.seeAlso, view.iri(robot_path(robot.name) + "history"))
        graph.add(iri, LF.from_, LF.unknown if past is None else timestamp(past.begin_ns))
        if past is None:
            return
        if past.end_ns is not None:
            graph.add(iri, LF.to, timestamp(past.end_ns))
        _describe_robots(graph, iri, recorded, past)
        _describe_objects(graph, iri, recorded, past)

    return found.replace(describe=describe, publishes_changes=False)


def _describe_robots(graph: Graph, iri: NamedNode, recorded: RecordedWorld, past: PastWorld) -> None:
    view, own = recorded.view, recorded.robot.name
    here = past.places.get(own, ORIGIN).position_m
    names = [name for name in past.places if name in view.robots]
    seen = sorted(names, key=lambda name: (dist(past.places[name].position_m, here), name))
    for name in seen[:MOST_ROBOTS]:
        robot, path = view.robots[name], robot_path(name)
        one, place = view.iri(path), view.iri(path + PLACEMENT)
        graph.add(iri, DCTERMS.hasPart, one)
        graph.add(one, DCTERMS.title, Literal(robot.title))
        graph.add(one, WORLD_LF.placement, place)
        describe_pose(graph, place, past.places[name])
        if robot.model is not None:
            graph.add(one, WORLD_LF.model, view.iri(model_path(name)))
            graph.add(one, LF.history, view.iri(path + "history"))
    graph.add(iri, LF.robotsNotDescribed, integer(max(0, len(seen) - MOST_ROBOTS)))


def _describe_objects(graph: Graph, iri: NamedNode, recorded: RecordedWorld, past: PastWorld) -> None:
    view, present = recorded.view, recorded.present.objects.known
    for id, each in sorted(past.objects.items(), key=lambda item: (item[1].title, item[0])):
        one = view.iri(object_path(id))
        graph.add(iri, LDP.contains, one)
        drawn = each.drawn(present.get(id))
        if drawn is None:
            describe_unreadable(graph, one)
            continue
        thing, is_kept = drawn
        describe_object(graph, view.base, id, thing, view.robots)
        if not is_kept:
            graph.add(one, LF.shapeNotKept, Literal(True))
