"""Discovery of Thing Descriptions (W3C WoT Discovery): ``/.well-known/wot`` and the directory ``/things``."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

from linked_fleet_gateway.extensions.things.td import DIRECTORY, TD, write_description
from linked_fleet_gateway.extensions.things.terms import LF
from linked_fleet_gateway.fleet.model import Joint, Link
from linked_fleet_gateway.fleet.robot import Robot
from linked_fleet_gateway.rdf.vocabulary import LDP
from linked_fleet_gateway.resources.branches import FleetBranch, Found, RequestView, ThingDocument
from linked_fleet_gateway.resources.paths import joint_path, link_path, part_of, robot_name, robot_path
from linked_fleet_gateway.resources.resource import Resource

MOST = 50
"""Most descriptions on one page."""
Place = tuple[Robot | None, Joint | Link | None]


@dataclass(frozen=True)
class Listing:
    """All things that the caller may see, as served by ``linked_fleet_gateway.extensions.things.http``."""

    view: RequestView

    def things(self) -> list[tuple[str, Place]]:
        """Return each thing with its id, in code point order of the ids (Discovery, 7.3.2.3)."""
        base = self.view.base
        found: list[tuple[str, Place]] = [(base + "/", (None, None))]
        for name, robot in self.view.robots.items():
            found.append((base + robot_path(name), (robot, None)))
            if (model := robot.model) is not None:
                for joint in model.joints.values():
                    found.append((base + joint_path(name, joint.name), (robot, joint)))
                for link in model.links.values():
                    found.append((base + link_path(name, model, link.name), (robot, link)))
        return sorted(found, key=lambda each: each[0])

    def version(self) -> bytes:
        """Return a key of all facts that descriptions depend on: while it is equal, they are."""
        facts: list[object] = [self.view.base, self.view.secured]
        for name, robot in sorted(self.view.robots.items()):
            said = robot.description
            known = None if said is None else (said.urdf, said.joints, said.base, said.capabilities)
            facts.append((name, robot.title, robot.model is None, known, robot.annotations))
        return repr(facts).encode()

    def description(self, place: Place) -> bytes:
        return write_description(self.view, *place)


def _entrance(view: RequestView, rest: Sequence[str]) -> Found:
    if list(rest) != ["wot"]:
        return None
    documents = {TD: partial(write_description, view, None, None)}
    return Resource("/.well-known/wot", "Thing Description", None, (LDP.Resource,), documents=documents)


def _directory(view: RequestView, rest: Sequence[str]) -> Found:
    """Return the listing or, if an id follows, the description of the thing with that IRI."""
    if not rest:
        return Resource(DIRECTORY, "Thing Descriptions", None, (LDP.Resource,), remote=Listing(view), followed=False)
    id = "/".join(rest)
    place = _place(view, id.removeprefix(view.base)) if id.startswith(view.base + "/") else None
    if place is None:
        return None
    return Resource(
        f"{DIRECTORY}/{id}",
        f"Thing Description of {id}",
        None,
        (LDP.Resource,),
        documents={TD: partial(write_description, view, *place)},
    )


def _place(view: RequestView, path: str) -> Place | None:
    if path == "/":
        return None, None
    head, _, part = path[1:].partition("/")
    try:
        robot = view.robots.get(robot_name(head))
        if robot is None or not part:
            return (robot, None) if robot is not None and path.endswith("/") else None
        if robot.model is None:
            return None
        joint, link = part_of(part, robot.model)
    except ValueError:
        return None
    return robot, (robot.model.joints[joint] if joint is not None else robot.model.links[link or ""])


BRANCHES = (
    FleetBranch(".well-known", None, _entrance),
    FleetBranch(DIRECTORY[1:], LF.things, _directory, takes_slashes=True),
    ThingDocument(TD, write_description),
)
