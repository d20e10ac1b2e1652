"""Reads the world of a fleet by HTTP: where robots stand, and its objects. Metre."""

import json
import urllib.error
import urllib.request
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from http.client import HTTPException
from typing import Any
from urllib.parse import unquote

from linked_fleet_agent.robots.contact_model import ContactObject, Grip, Triangles
from linked_fleet_agent.urdf.geometry import Box, Cylinder, Sphere
from linked_fleet_agent.urdf.poses import Pose
from linked_fleet_agent.wire.keys import unescape

_TIMEOUT_S = 5.0
_OPENER = urllib.request.build_opener(urllib.request.ProxyHandler({}))  # no proxy for loopback
Node = Mapping[str, Any]


@dataclass(frozen=True)
class World:
    """Placements of robots, by name, and objects, whose names are their titles."""

    placements: Mapping[str, Pose]
    objects: tuple[ContactObject, ...]


class WorldReader:
    """Reads the world of the fleet at ``root``; ``surface_of`` returns the surface of an STL, None if it is unusable.

    Documents that have not changed are not transferred again.
    """

    def __init__(self, root: str, surface_of: Callable[[bytes], Triangles | None]) -> None:
        self._root, self._surface_of = root, surface_of
        self._kept: dict[str, tuple[str, Any]] = {}
        self._world = World({}, ())

    def read(self) -> World:
        """Return the world; the same one if nothing has changed. Raises OSError, HTTPException."""
        try:
            world, objects = (self._graph(f"{self._root}{path}") for path in ("world", "world/objects"))
            if world[1] or objects[1]:
                self._world = World(dict(self._placements(world[0])), tuple(self._objects(objects[0])))
        except (OSError, HTTPException):
            self._kept.clear()  # what was read of it is in no world yet
            raise
        return self._world

    def stop(self, robot: str, reason: str) -> None:
        """Cause a protective stop of a simulated robot. Raises OSError."""
        url = f"{self._root}{robot}/simulation/actions/stopProtectively"
        headers = {"Content-Type": "application/json"}
        body = json.dumps({"reason": reason[:500]}).encode()
        _OPENER.open(urllib.request.Request(url, body, headers), timeout=_TIMEOUT_S).close()  # noqa: S310 (http alone)

    def _graph(self, url: str) -> tuple[dict[str, Node], bool]:
        """Return the nodes of a document, and whether they are other ones than the last time."""
        etag, kept = self._kept.get(url, ("", {}))
        headers = {"Accept": "application/ld+json", "If-None-Match": etag or '"none"'}
        try:
            with _OPENER.open(urllib.request.Request(url, headers=headers), timeout=_TIMEOUT_S) as answer:  # noqa: S310
                document, etag = json.loads(answer.read()), answer.headers.get("ETag", "")
        except urllib.error.HTTPError as error:
            if error.code != 304:
                raise
            return kept, False
        nodes = {each["@id"]: each for each in document.get("@graph", [document]) if "@id" in each}
        self._kept[url] = etag, nodes
        return nodes, True

    def _placements(self, nodes: dict[str, Node]) -> Any:
        for each in nodes.values():
            where = nodes.get(_id(each.get("lf:placement")))
            pose = None if where is None else _pose(where)
            if pose is not None:
                yield self._name(each["@id"]), pose

    def _name(self, iri: str) -> str:
        return unescape(iri.removeprefix(self._root).partition("/")[0])

    def _objects(self, nodes: dict[str, Node]) -> Any:
        """Yield the obstacles, without zones and what cannot be used."""
        for iri, each in nodes.items():
            pose, geometry = _pose(each), None
            if "lf:Obstacle" in each.get("@type", ()) and pose is not None:
                geometry = self._geometry(each["lf:geometry"])
            if geometry is not None and pose is not None:
                holder = _id(each.get("lf:heldBy")).removeprefix(self._root)
                robot, _, link = holder.partition("/")
                held = Grip(unescape(robot), unescape(unquote(link))) if link else None
                title = each.get("dcterms:title", "an object")
                yield ContactObject(iri, geometry, pose, held, title if isinstance(title, str) else "an object")

    def _geometry(self, said: Node) -> Box | Sphere | Cylinder | Triangles | None:
        match said["@type"]:
            case "lf:Box":
                return Box(_vector(said["lf:size"]))
            case "lf:Sphere":
                return Sphere(_metres(said["lf:radius"]))
            case "lf:Cylinder":
                return Cylinder(_metres(said["lf:radius"]), _metres(said["lf:length"]))
        with _OPENER.open(_id(said["lf:mesh"]), timeout=_TIMEOUT_S) as answer:
            return self._surface_of(answer.read())


def _id(node: Any) -> str:
    return str(node.get("@id", "")) if isinstance(node, dict) else ""


def _pose(said: Node) -> Pose | None:
    """Return the pose that is said; None if it is unknown."""
    try:
        turn = said["lf:orientation"]
        x, y, z, w = (_number(turn[each]) for each in ("maths:x", "maths:y", "maths:z", "lf:w"))
        return Pose(_vector(said["lf:position"]), (x, y, z, w))
    except LookupError:
        return None


def _vector(said: Node) -> tuple[float, float, float]:
    x, y, z = (_number(said[each]) for each in ("maths:x", "maths:y", "maths:z"))
    return (x, y, z)


def _metres(said: Any) -> float:
    return _number(said.get("vom:numericalValue", said))


def _number(said: Any) -> float:
    return float(said["@value"] if isinstance(said, dict) else said)
