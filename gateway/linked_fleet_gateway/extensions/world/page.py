"""The pages of the world and its objects, with forms that add and change objects."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

from pyoxigraph import BlankNode, NamedNode

from linked_fleet_base.lazy_imports import LazyModule
from linked_fleet_gateway.api import Right
from linked_fleet_gateway.extensions.pages import texts
from linked_fleet_gateway.extensions.pages.form_parts import Form, Group, Leaf
from linked_fleet_gateway.extensions.pages.languages import message, say
from linked_fleet_gateway.extensions.pages.thing_views import path_below
from linked_fleet_gateway.extensions.pages.values import Facts, Link, Value
from linked_fleet_gateway.extensions.pages.views import PageView, Part
from linked_fleet_gateway.extensions.world.descriptions import (
    OBJECTS,
    PREDICATES_OF_GEOMETRY,
    describe_object,
    object_path,
)
from linked_fleet_gateway.extensions.world.map_resources import MAP
from linked_fleet_gateway.extensions.world.placement import LF, WORLD
from linked_fleet_gateway.extensions.world.scene import Box, SceneObject
from linked_fleet_rdf.graph import Graph
from linked_fleet_rdf.turtle import Term
from linked_fleet_rdf.vocabulary import DCTERMS, LDP, MATHS, RDF, RDFS
from linked_fleet_state.model import Pose

if TYPE_CHECKING:
    from linked_fleet_gateway.extensions.pages import form
else:
    form = LazyModule("linked_fleet_gateway.extensions.pages.form")

_KINDS = (LF.Obstacle, LF.KeepOutZone)
_EDGE_M = 0.4
_TEMPLATES = Path(__file__).parent / "templates"


@dataclass(frozen=True)
class PlacedRobot:
    """A robot in the world and the URL of its placement."""

    link: Link
    placement: str
    placed: bool


def world(facts: Facts, iri: NamedNode) -> Part:
    robots = facts.nodes(iri, DCTERMS.hasPart)
    placements = {each: facts.one(each, LF.placement) for each in robots}
    standing = [_standing(facts, each, placements[each]) for each in robots]
    more = {
        "robots": standing,
        "objects": path_below(facts.iri_of(iri, LF.objects), facts.root),
        "collisions": path_below(facts.iri_of(iri, LF.collisions), facts.root),
        "map": path_below(facts.iri_of(iri, LF.map), facts.root),
    }
    done = {each for each in (*robots, *placements.values()) if isinstance(each, NamedNode)}
    return Part(more, {DCTERMS.hasPart}, done)


def _standing(facts: Facts, iri: NamedNode, placement: Term | None) -> PlacedRobot:
    position = facts.one(placement, LF.position) if isinstance(placement, NamedNode) else None
    x = facts.one(position, MATHS.x) if isinstance(position, BlankNode) else None
    return PlacedRobot(facts.link(iri), path_below(getattr(placement, "value", ""), facts.root), x != LF.unknown)


def floor(facts: Facts, iri: NamedNode) -> Part:
    more = {"map": MAP, "world": WORLD, "objects": OBJECTS, "present": facts.one(iri, LF.mapImage) is not None}
    return Part(more)


# -- refused motions ------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class RefusedMotion:
    """A refused motion: its time, the reason, and the colliding things."""

    when: Value | None
    reason: str
    things: Sequence[Link]


def collisions(facts: Facts, iri: NamedNode) -> Part:
    nodes = [each for each in facts.all(iri, LF.collision) if isinstance(each, BlankNode)]
    things = {each for node in nodes for each in facts.nodes(node, LF.meets)}
    return Part({"refused": [_refused(facts, each) for each in nodes]}, {LF.collision}, {*nodes, *things})


def _refused(facts: Facts, node: BlankNode) -> RefusedMotion:
    met = facts.nodes(node, LF.meets)
    when = facts.values(node, DCTERMS.created)
    links = [Link(facts.text(each, RDFS.label), each.value, each.value) for each in met]
    return RefusedMotion(when[0] if when else None, facts.text(node, LF.reason), links)


# -- objects --------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class ObjectRow:
    """An object in the list."""

    link: Link
    kind: str
    form: str
    position: Value | None


def container(facts: Facts, iri: NamedNode) -> Part:
    members = facts.nodes(iri, LDP.contains)
    listed = [_listed(facts, each) for each in members]
    more = {"listed": listed, "count": len(members), "form": _form(iri.value, "POST", say("add"), *_example())}
    return Part(more, {LDP.contains, LDP.constrainedBy, RDFS.seeAlso}, set(members))


def thing(facts: Facts, iri: NamedNode) -> Part:
    return Part({"form": _form(iri.value, "PUT", say("save"), facts, iri)})


def unreadable(facts: Facts, iri: NamedNode) -> Part:
    return Part({}, {RDFS.comment})


def _listed(facts: Facts, iri: NamedNode) -> ObjectRow:
    kinds = [each for each in _KINDS if facts.is_a(iri, each)]
    forms = facts.nodes(iri, LF.geometry, RDF.type)
    positions = facts.values(iri, LF.position)
    return ObjectRow(
        facts.link(iri),
        texts.choice_label(kinds[0].value) if kinds else "",
        texts.choice_label(forms[0].value) if forms else "",
        positions[0] if positions else None,
    )


def _form(action: str, method: str, name: str, facts: Facts, subject: NamedNode) -> Form:
    """Return the form of an object, with a choice of its kind, and without its frame, which is the world.

    The frame of a held object is the link that holds it.
    """
    made = form.form_of_shape(LF.SceneObjectInput, action, method, name, facts, subject, Right.ADMIN)
    kind = Leaf(
        path=RDF.type.value,
        label=say("kind"),
        hint="",
        required=True,
        input="select",
        iri=True,
        datatype="",
        value=next((each.value for each in _KINDS if facts.is_a(subject, each)), ""),
        options=[(each.value, texts.choice_label(each.value)) for each in _KINDS],
    )
    title, *others = sorted(made.needed, key=lambda each: each.path != DCTERMS.title.value)
    hidden = {RDF.type.value} if facts.one(subject, LF.heldBy) else {RDF.type.value, LF.inFrame.value}
    further = [each for each in made.further if each.path not in hidden]
    return replace(made, needed=[title, kind, *map(_by_type, others)], further=further)


def _by_type(field: Leaf | Group) -> Leaf | Group:
    """Return the geometry field with the fields of each of its types."""
    if not isinstance(field, Group) or field.path != LF.geometry.value:
        return field
    fields = [replace(each, when=_types_with(each.path)) for each in field.fields if _is_asked(each)]
    return replace(field, fields=fields)


def _is_asked(field: Leaf | Group) -> bool:
    """Return False for the mesh that an object already has, which is kept."""
    return field.path != LF.mesh.value or (isinstance(field, Leaf) and bool(field.value))


def _types_with(path: str) -> Sequence[str]:
    found = [type_ for type_, used in PREDICATES_OF_GEOMETRY.items() if NamedNode(path) in used]
    return [each.value for each in found if isinstance(each, NamedNode)]


@cache
def _example() -> tuple[Facts, NamedNode]:
    """Return a box on the floor as initial values."""
    graph, root = Graph(), "urn:example:"
    edges = (_EDGE_M, _EDGE_M, _EDGE_M)
    box = SceneObject(
        title="", kind="obstacle", pose=Pose((0.0, 0.0, _EDGE_M / 2), (0.0, 0.0, 0.0, 1.0)), geometry=Box(edges)
    )
    describe_object(graph, root, "new", box, {})
    return Facts(graph.triples, root), NamedNode(root + object_path("new"))


VIEW = PageView(
    LF.World,
    _TEMPLATES / "world.html",
    world,
    constants={"objects": OBJECTS},
    help=message("Where robots and objects stand. Objects that are entered here are kept clear of by motions."),
    guide="docs/FLOOR.md",
)
COLLISIONS_VIEW = PageView(
    LF.Collisions,
    _TEMPLATES / "collisions.html",
    collisions,
    help=message("Motions that were refused because they would have ended in a collision."),
    guide="docs/FLOOR.md",
)
MAP_VIEW = PageView(
    LF.OccupancyMap,
    _TEMPLATES / "occupancy_map.html",
    floor,
    help=message("The floor from above, with robots and objects. Load a map of your building here."),
    guide="docs/FLOOR.md",
)
CONTAINER_VIEW = PageView(
    LF.SceneObjects,
    _TEMPLATES / "scene_objects.html",
    container,
    help=message("Objects that robots must not touch, and zones that they must not enter."),
    guide="docs/FLOOR.md",
)
UNREADABLE_VIEW = PageView(
    LF.UnreadableObject,
    _TEMPLATES / "unreadable_object.html",
    unreadable,
    help=message("An object that is there, and about which nothing is known."),
    guide="docs/FLOOR.md",
)
TITLES = (message("An object that cannot be read"), message("A map of the floor that cannot be read"))
"""Titles of resources, for their translation."""
OBJECT_VIEW = PageView(
    LF.SceneObject,
    _TEMPLATES / "scene_object.html",
    thing,
    help=message("One object or zone: where it stands, and its size."),
    guide="docs/FLOOR.md",
)
