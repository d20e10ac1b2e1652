"""Discovery of Thing Descriptions (W3C WoT Discovery): ``/.well-known/wot`` and the directory ``/things``.

A page of the directory in RDF has things with their names and classes, in the order of their ids. The terms of the
extension are here too.
"""

from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from hashlib import blake2b
from typing import Any

from pyoxigraph import Literal, NamedNode

from linked_fleet_agent.wire.messages import Description
from linked_fleet_gateway.api import (
    Container,
    FleetBranch,
    Found,
    RequestView,
    Resource,
    joint_path,
    link_path,
    robot_path,
    thing_at,
    time_sliced,
)
from linked_fleet_gateway.extensions.things.td import (
    DIRECTORY,
    TD,
    Thing,
    placeholder_description,
    thing_description,
    types_of,
)
from linked_fleet_gateway.faces import Offer, RobotPart, ThingDocument, parts_of
from linked_fleet_rdf.graph import Graph
from linked_fleet_rdf.vocabulary import DCTERMS, LDP, RDFS, XHV
from linked_fleet_rdf.vocabulary import LF as CORE
from linked_fleet_state.model import Joint, Link
from linked_fleet_state.robot import Robot

LF = CORE.extended("Directory things")

MOST = 50
"""Most descriptions on one page."""
_LIST, _THINGS = "the list of things", "things"
Place = tuple[Robot | None, Joint | Link | RobotPart | None]


Containers = Callable[[], Iterable[Container[Any]]]
"""Returns the containers, the actions of whose members the fleet offers."""


class RobotDigests:
    """Digests of the facts of robots that their descriptions depend on; a description takes long to digest."""

    def __init__(self) -> None:
        self._known: dict[str, tuple[Description | None, bytes]] = {}

    def digest(self, name: str, robot: Robot) -> bytes:
        said = robot.description
        known, of_description = self._known.get(name, (None, b""))
        if known is not said or not of_description:
            of_description = blake2b(repr(said).encode(), digest_size=16).digest()
            self._known[name] = (said, of_description)
        # Components are read from the description a little later.
        facts = (name, robot.title, robot.model is None, robot.annotations, sorted(parts_of(robot)))
        return blake2b(repr(facts).encode() + of_description, digest_size=16).digest()

    def forget_others(self, names: Collection[str]) -> None:
        for name in self._known.keys() - names:
            del self._known[name]


@dataclass(frozen=True)
class Listing:
    """All things that the caller may see, as served by ``linked_fleet_gateway.extensions.things.extension``."""

    view: RequestView
    containers: Containers = tuple

    async def things(self) -> list[tuple[str, Place]]:
        """Return each thing with its id, in code point order of the ids (Discovery, 7.3.2.3)."""
        base = self.view.base
        found: list[tuple[str, Place]] = [(base + "/", (None, None))]
        async for name, robot in time_sliced(list(self.view.robots.items())):
            found.append((base + robot_path(name), (robot, None)))
            with self.view.faults.guard(_LIST, name):
                found += list(self._parts(name, robot))
        return sorted(found, key=lambda each: each[0])

    def _parts(self, name: str, robot: Robot) -> Iterator[tuple[str, Place]]:
        if (model := robot.model) is not None:
            for joint in model.joints.values():
                yield self.view.base + joint_path(name, joint.name), (robot, joint)
            for link in model.links.values():
                yield self.view.base + link_path(name, model, link.name), (robot, link)
            for part in parts_of(robot).values():
                yield self.view.base + part.path, (robot, part)

    async def version(self, digests: RobotDigests) -> bytes:
        """Return a digest of all facts that descriptions depend on: while it is equal, they are."""
        facts = blake2b(repr((self.view.base, self.view.requires_authentication)).encode(), digest_size=16)
        async for name, robot in time_sliced(sorted(self.view.robots.items())):
            facts.update(digests.digest(name, robot))
        for container in self.containers():
            async for member, _ in time_sliced(container.own_actions(self.view)):
                facts.update(repr((member.path, member.record)).encode())
        return facts.digest()

    def description(self, id: str, place: Place) -> bytes | None:
        """Return a description, or one that says why there is no more of it; None if the thing is gone."""
        robot, part = place
        about, faults = (robot.name if robot else "", part.name if part else ""), self.view.faults
        with faults.guard(_THINGS, *about):
            return write_description(self.containers, self.view, *place) if self._is_present(place) else None
        return placeholder_description(id, self.view.requires_authentication, faults.find(_THINGS, *about))

    def _is_present(self, place: Place) -> bool:
        """Return True if the robot of a listed part has had no other description since."""
        robot, part = place
        if robot is None or part is None:
            return True
        model = robot.model
        if model is None:
            return False
        return any(
            part is each
            for each in (model.joints.get(part.name), model.links.get(part.name), *parts_of(robot).values())
        )


def write_description(
    containers: Containers, view: RequestView, robot: Robot | None, part: Joint | Link | RobotPart | None
) -> bytes:
    """Return the Thing Description of the fleet (no robot), a robot, or a part of it."""
    thing = Thing(view.base, view.requires_authentication, robot, part)
    return thing_description(thing, view.robots, [] if robot is not None else _actions_of_members(containers, view))


def _actions_of_members(containers: Containers, view: RequestView) -> list[Offer]:
    found = list[Offer]()
    for container in containers():
        with view.faults.guard(_THINGS, thing=container.path):
            for _, offers in container.own_actions(view):
                found += offers
    return found


def _entrance(containers: Containers, view: RequestView, rest: Sequence[str]) -> Found:
    if list(rest) != ["wot"]:
        return None
    documents = {TD: partial(write_description, containers, view, None, None)}
    return Resource("/.well-known/wot", "Thing Description", None, (LDP.Resource,), documents=documents)


def _directory(containers: Containers, view: RequestView, rest: Sequence[str]) -> Found:
    """Return the listing or, if an id follows, the description of the thing with that IRI."""
    if not rest:
        listing = Listing(view, containers)
        return Resource(DIRECTORY, "Thing Descriptions", None, (LDP.Resource,), remote=listing, publishes_changes=False)
    id = "/".join(rest)
    place = _place(view, id.removeprefix(view.base)) if id.startswith(view.base + "/") else None
    if place is None:
        return None
    return Resource(
        f"{DIRECTORY}/{id}",
        f"Thing Description of {id}",
        None,
        (LDP.Resource,),
        documents={TD: partial(write_description, containers, view, *place)},
    )


def _place(view: RequestView, path: str) -> Place | None:
    if path == "/":
        return None, None
    return thing_at(path, view.robots)


def branches(containers: Containers = tuple) -> tuple[FleetBranch | ThingDocument, ...]:
    """Return the branches of the directory, and the further representation of things."""
    return (
        FleetBranch(".well-known", None, partial(_entrance, containers)),
        FleetBranch(DIRECTORY[1:], LF.things, partial(_directory, containers), allows_encoded_slashes=True),
        ThingDocument(TD, partial(write_description, containers)),
    )


MOST_LISTED = 200
"""Most things on one page."""


def describe_page(
    view: RequestView, things: Sequence[tuple[str, Place]], offset: int, limit: int, graph: Graph
) -> None:
    iri = view.iri(DIRECTORY)
    graph.a(iri, LF.Directory, LDP.Container)
    graph.add(iri, DCTERMS.title, Literal("Things"))
    graph.add(iri, RDFS.seeAlso, view.iri("/"))
    end = offset + limit
    if offset:
        graph.add(iri, XHV.prev, view.iri(f"{DIRECTORY}?offset={max(0, offset - limit)}&limit={limit}"))
    if end < len(things):
        graph.add(iri, XHV.next, view.iri(f"{DIRECTORY}?offset={end}&limit={limit}"))
    for id, place in things[offset:end]:
        thing, (robot, part) = NamedNode(id), place
        graph.add(iri, LDP.contains, thing)
        if robot is None:
            graph.a(thing, LF.Fleet)
            graph.add(thing, DCTERMS.title, Literal("Linked Fleet"))
        elif part is None:
            graph.a(thing, LF.Robot)
            graph.add(thing, DCTERMS.title, Literal(robot.title))
        else:
            graph.a(thing, *types_of(part))
            graph.add(thing, DCTERMS.title, Literal(part.name))
