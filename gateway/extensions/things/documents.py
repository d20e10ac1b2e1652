"""What things and properties are for neighbours that speak no RDF: Thing Descriptions, and plain JSON.

Nothing is imported, and nothing written, before somebody asks for it.
"""

from collections.abc import Callable
from dataclasses import replace
from functools import partial

from pyoxigraph import NamedNode

from gateway.fleet.model import Joint, Link
from gateway.fleet.robot import Robot
from gateway.rdf.graph import Graph
from gateway.rdf.vocabulary import LF
from gateway.resources.extension import Sight
from gateway.resources.resource import Resource

JSON, TD = "application/json", "application/td+json"
DIRECTORY, MOST = "/things", 50
"""Path of the directory of Thing Descriptions, and the most that one page of it has."""
Documents = dict[str, Callable[[], bytes]]


def of_thing(sight: Sight, robot: Robot | None = None, part: Joint | Link | None = None) -> Documents:
    """The Thing Description of the fleet, a robot, or a part of it."""
    return {TD: partial(_thing_description, sight, robot, part)}


def with_json(resource: Resource, shape: NamedNode, base: str) -> Resource:
    """The resource with its values in plain JSON besides, if ``shape`` says which those are."""
    if resource.describe is None or shape == LF.AnnotationsShape:
        return resource
    write = partial(_json, resource.describe, base + resource.path, shape)
    return replace(resource, documents={**resource.documents, JSON: write})


def _thing_description(sight: Sight, robot: Robot | None, part: Joint | Link | None) -> bytes:
    from gateway.extensions.things.td import Thing, thing_description

    return thing_description(Thing(sight.base, sight.secured, robot, part), sight.robots)


def _json(describe: Callable[[Graph], None], iri: str, shape: NamedNode) -> bytes:
    from gateway.extensions.things.plain import document

    return document(describe, NamedNode(iri), shape)
