"""Bodies of objects, converted from triples to typed values after validation by the published shape."""

import base64
import binascii
from collections.abc import Sequence
from functools import cache

from pyoxigraph import NamedNode, Triple

from linked_fleet_gateway.base.errors import UnprocessableContent
from linked_fleet_gateway.extensions.world.placement import read_pose, read_vector
from linked_fleet_gateway.extensions.world.scene import (
    FARTHEST_M,
    Box,
    Cylinder,
    Geometry,
    Kind,
    SceneObject,
    Sphere,
    TriangleMesh,
    read_stl,
)
from linked_fleet_gateway.extensions.world.terms import LF
from linked_fleet_gateway.fleet.model import Pose
from linked_fleet_gateway.rdf.graph import Node
from linked_fleet_gateway.rdf.unused import refuse
from linked_fleet_gateway.rdf.vocabulary import DCTERMS, RDF
from linked_fleet_gateway.resources.action_body import Body
from linked_fleet_gateway.resources.json_form import Field, Form, Value, form_of
from linked_fleet_gateway.resources.setting import validated

PREDICATES_OF_GEOMETRY: dict[Node, tuple[NamedNode, ...]] = {
    LF.Box: (LF.size,),
    LF.Sphere: (LF.radius,),
    LF.Cylinder: (LF.radius, LF.length),
    LF.TriangleMesh: (LF.stl, LF.mesh),
}
"""Predicates of each type of geometry."""

_KINDS = {each.value: each for each in (LF.Obstacle, LF.KeepOutZone)}


@cache
def object_form() -> Form:
    """Return the form of an object in plain JSON: the members of its shape, and its kind."""
    kind = Value({"type": "string", "enum": list(_KINDS)}, terms=_KINDS)
    known = form_of(LF.SceneObjectInput).fields
    return Form((*known, Field("kind", (RDF.type,), kind, most=1, description="an obstacle, if nothing is said")))


def read_object(
    triples: Sequence[Triple],
    iri: str,
    world: str,
    present: SceneObject | None = None,
    described: frozenset[Triple] = frozenset(),
) -> SceneObject:
    """Parse an object for ``iri``, in place of ``present``, whose description is ``described``.

    Raises UnprocessableContent, which states the valid form.
    """
    body = validated(triples, LF.SceneObjectInput, iri, described)
    frames = body.nodes(body.root, LF.inFrame)
    if any(each != NamedNode(world) for each in frames):
        raise UnprocessableContent(f"Objects stand in the frame of the world: lf:inFrame is <{world}>, or left out.")
    types = body.nodes(body.root, RDF.type)
    if LF.Obstacle in types and LF.KeepOutZone in types:
        raise UnprocessableContent("An object is a lf:Obstacle or a lf:KeepOutZone, not both.")
    title, geometry, pose = body.text(body.root, DCTERMS.title), body.node(body.root, LF.geometry), read_pose(body)
    assert title is not None and geometry is not None
    _check_near(pose)
    _check_form(body, geometry, iri, present)
    kind: Kind = "zone" if LF.KeepOutZone in types else "obstacle"
    return SceneObject(title=title, kind=kind, pose=pose, geometry=_geometry(body, geometry, iri, present))


def _check_form(body: Body, node: Node, iri: str, present: SceneObject | None) -> None:
    """Refuse predicates of other types of geometry, which the common shape allows."""
    form = body.node(node, RDF.type)
    assert form is not None
    other = {each for said in PREDICATES_OF_GEOMETRY.values() for each in said}.difference(PREDICATES_OF_GEOMETRY[form])
    if present is None or any(each != NamedNode(iri + "/mesh") for each in body.nodes(node, LF.mesh)):
        other.add(LF.mesh)
    refuse([t for t in body.triples if t.subject == node and t.predicate in other], f"{iri}/blueprint")


def _check_near(pose: Pose) -> None:
    if max(map(abs, pose.position_m)) > FARTHEST_M:
        raise UnprocessableContent(f"Objects stand within {FARTHEST_M:g} m of the origin of the world.")


def _geometry(body: Body, node: Node, iri: str, present: SceneObject | None) -> Geometry:
    form = body.node(node, RDF.type)
    if form == LF.TriangleMesh:
        return _mesh(body, node, iri, present)
    if form == LF.Box:
        x, y, z = (_extent(edge) for edge in read_vector(body, _part(body, node, LF.size)))
        return Box((x, y, z))
    radius = _length(body, node, LF.radius)
    return Sphere(radius) if form == LF.Sphere else Cylinder(radius, _length(body, node, LF.length))


def _part(body: Body, node: Node, predicate: NamedNode) -> Node:
    found = body.node(node, predicate)
    if found is None:
        raise UnprocessableContent(f"This geometry has a {predicate.value.replace(LF.iri, 'lf:')}; see the blueprint.")
    return found


def _length(body: Body, node: Node, predicate: NamedNode) -> float:
    return _extent(body.quantity(_part(body, node, predicate)))


def _extent(length_m: float) -> float:
    if not 0 < length_m <= FARTHEST_M:
        raise UnprocessableContent(f"An extent of {length_m:g} m is not above 0 and at most {FARTHEST_M:g} m.")
    return length_m


def _mesh(body: Body, node: Node, iri: str, present: SceneObject | None) -> TriangleMesh:
    text = body.text(node, LF.stl)
    if text is None:
        kept = (
            present.geometry if present is not None and body.node(node, LF.mesh) == NamedNode(iri + "/mesh") else None
        )
        if not isinstance(kept, TriangleMesh):
            raise UnprocessableContent("A lf:TriangleMesh has its lf:stl, or the lf:mesh that the object has already.")
        return kept
    try:
        return read_stl(base64.b64decode("".join(text.split()), validate=True))
    except (binascii.Error, ValueError) as error:
        raise UnprocessableContent(f"lf:stl cannot be used: {error}.") from error
