"""The world as triples: placements of robots, and objects. Pure.

Bodies of objects are converted from triples to typed values after validation by the published shape.
"""

import base64
import binascii
from collections.abc import Iterable, Mapping, Sequence
from functools import cache

from pyoxigraph import Literal, NamedNode, Triple

from linked_fleet_base.errors import UnprocessableContent
from linked_fleet_base.faults import Faults
from linked_fleet_gateway.api import Body, link_path, robot_path
from linked_fleet_gateway.extensions.models.geometry import model_path
from linked_fleet_gateway.extensions.world.held import Robots, StatedObject, path_of
from linked_fleet_gateway.extensions.world.placement import (
    LF,
    PLACEMENT,
    WORLD,
    describe_placement,
    describe_pose,
    read_pose,
    read_vector,
)
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
from linked_fleet_gateway.faces import Form, RelativePose, form_of, validate_body
from linked_fleet_rdf.graph import METRE, Graph, Node
from linked_fleet_rdf.validation import refuse_statements
from linked_fleet_rdf.vocabulary import DCTERMS, HYBRIT, HYDRA, LDP, RDF, RDFS
from linked_fleet_rdf.vocabulary import LF as CORE_LF
from linked_fleet_state.model import Pose
from linked_fleet_state.robot import Robot

OBJECTS, POSES = f"{WORLD}/objects", f"{WORLD}/pose"
STL = "model/stl"
MAX_DESCRIBED = 100
"""Objects that the container describes; others are only listed."""
Objects = Mapping[str, SceneObject]
UNREADABLE = "An object that cannot be read"


def object_path(id: str) -> str:
    return f"{OBJECTS}/{id}"


def describe_world(graph: Graph, base: str, robots: Iterable[Robot], faults: Faults) -> None:
    """Describe the frame tree down to the root links, where the joints of each robot continue it.

    A robot that cannot be described has the reason as its fault.
    """
    robots = sorted(robots, key=lambda robot: robot.name)
    describe_frame(graph, base, robots)
    for robot in robots:
        with faults.guard("the world", robot.name):
            _describe_robot(graph, base, robot)
        if reason := faults.find("the world", robot.name):
            graph.add(NamedNode(base + robot_path(robot.name)), CORE_LF.fault, Literal(reason))


def describe_frame(graph: Graph, base: str, robots: Iterable[Robot]) -> None:
    """Describe the world with its robots, without their placements."""
    iri = NamedNode(base + WORLD)
    graph.a(iri, LF.World)
    graph.add(iri, DCTERMS.title, Literal("World"))
    graph.add(iri, RDFS.seeAlso, NamedNode(base + "/"))
    graph.add(iri, HYBRIT.blueprint, LF.WorldShape, NamedNode(iri.value + "/blueprint"))
    graph.add(iri, LF.objects, NamedNode(base + OBJECTS))
    graph.add(iri, LF.poses, NamedNode(base + POSES))
    graph.add(iri, LF.collisions, NamedNode(iri.value + "/collisions"))
    graph.add(iri, LF.map, NamedNode(iri.value + "/map"))
    graph.add(iri, DCTERMS.hasPart, *(NamedNode(base + robot_path(robot.name)) for robot in robots))


def _describe_robot(graph: Graph, base: str, robot: Robot) -> None:
    path = robot_path(robot.name)
    iri, placement = NamedNode(base + path), NamedNode(base + path + PLACEMENT)
    graph.a(iri, HYBRIT.RoboticThing, LF.Robot)
    graph.add(iri, DCTERMS.title, Literal(robot.title))
    graph.add(iri, LF.placement, placement)
    if robot.model is not None and robot.description is not None:
        graph.add(iri, LF.rootLink, NamedNode(base + link_path(robot.name, robot.model, robot.model.root)))
        graph.add(iri, LF.model, NamedNode(base + model_path(robot.name)))
        graph.add(iri, LF.jointState, NamedNode(base + path + "jointState"))
        if robot.description.base == "floating":
            graph.add(iri, LF.pose, NamedNode(base + path + "pose"))
    graph.a(placement, LF.Placement, HYBRIT.Property)
    graph.add(placement, DCTERMS.title, Literal(f"placement of {robot.name}"))
    graph.add(placement, RDFS.seeAlso, iri)
    graph.add(placement, HYBRIT.blueprint, LF.PlacementShape, NamedNode(placement.value + "/blueprint"))
    graph.add(placement, HYBRIT.consumes, LF.PlacementInput)
    describe_placement(graph, placement, robot)
    graph.add(placement, LF.inFrame, NamedNode(base + WORLD))


def describe_objects(
    graph: Graph,
    base: str,
    objects: Objects,
    robots: Robots,
    most: int = MAX_DESCRIBED,
    unreadable: Sequence[str] = (),
) -> None:
    """Describe the LDP container of the objects; the first ``most``, by title, are described completely.

    ``robots`` are those that the reader may know of, ``unreadable`` the paths of objects whose records cannot be read.
    """
    iri = NamedNode(base + OBJECTS)
    graph.a(iri, LF.SceneObjects, LDP.BasicContainer, LDP.Container)
    graph.add(iri, DCTERMS.title, Literal("Objects of the world"))
    graph.add(iri, RDFS.seeAlso, NamedNode(base + WORLD))
    graph.add(iri, LDP.constrainedBy, LF.SceneObjectInput)
    graph.add(iri, HYBRIT.blueprint, LF.SceneObjectsShape, NamedNode(iri.value + "/blueprint"))
    ordered = sorted(objects.items(), key=lambda each: (each[1].title, each[0]))
    graph.add(iri, LDP.contains, *(NamedNode(base + object_path(id)) for id, _ in ordered))
    for id, thing in ordered[:most]:
        describe_object(graph, base, id, thing, robots)
    for path in unreadable:
        graph.add(iri, LDP.contains, NamedNode(base + path))
        describe_unreadable(graph, NamedNode(base + path))


def describe_unreadable(graph: Graph, iri: NamedNode) -> None:
    """Say that an object is there, and cannot be read."""
    graph.a(iri, LF.UnreadableObject)
    graph.add(iri, DCTERMS.title, Literal(UNREADABLE))
    graph.add(iri, RDFS.comment, Literal("Robots with a placement do not move until it is replaced or deleted."))


def describe_object(graph: Graph, base: str, id: str, thing: SceneObject, robots: Robots) -> None:
    """Describe an object. The position of a held one is in the frame of its link; unknown if that is not known."""
    iri = NamedNode(base + object_path(id))
    graph.a(iri, LF.SceneObject, LF.Obstacle if thing.kind == "obstacle" else LF.KeepOutZone)
    graph.add(iri, DCTERMS.title, Literal(thing.title))
    graph.add(iri, RDFS.seeAlso, NamedNode(base + OBJECTS))
    graph.add(iri, HYBRIT.blueprint, LF.SceneObjectShape, NamedNode(iri.value + "/blueprint"))
    if thing.held is None:
        describe_pose(graph, iri, thing.pose)
        graph.add(iri, LF.inFrame, NamedNode(base + WORLD))
    elif link := path_of(thing.held, robots):
        describe_pose(graph, iri, thing.held.pose)
        graph.add(iri, LF.inFrame, NamedNode(base + link))
        graph.add(iri, LF.heldBy, NamedNode(base + link))
    else:
        describe_pose(graph, iri, None)
        graph.add(iri, LF.inFrame, NamedNode(base + WORLD))
    geometry = graph.blank()
    graph.add(iri, LF.geometry, geometry)
    _describe_geometry(graph, geometry, thing.geometry, iri)


def _describe_geometry(graph: Graph, node: Node, geometry: Geometry, thing: NamedNode) -> None:
    if isinstance(geometry, Box):
        graph.a(node, LF.Box)
        graph.vector(node, LF.size, geometry.size_m, METRE)
    elif isinstance(geometry, Sphere):
        graph.a(node, LF.Sphere)
        graph.scalar(node, LF.radius, geometry.radius_m, METRE)
    elif isinstance(geometry, Cylinder):
        graph.a(node, LF.Cylinder)
        graph.scalar(node, LF.radius, geometry.radius_m, METRE)
        graph.scalar(node, LF.length, geometry.length_m, METRE)
    else:
        graph.a(node, LF.TriangleMesh)
        graph.add(node, LF.mesh, NamedNode(thing.value + "/mesh"))


def describe_template(graph: Graph, base: str) -> None:
    """Describe the template for poses (RFC 6570 in the Hydra vocabulary)."""
    iri = NamedNode(base + POSES)
    graph.a(iri, HYDRA.IriTemplate)
    graph.add(iri, DCTERMS.title, Literal("Poses of things in the frames of others"))
    comment = "of, in: IRIs of the world, a robot (its root link), a link or an object; without in, of the world."
    graph.add(iri, RDFS.comment, Literal(comment))
    graph.add(iri, RDFS.seeAlso, NamedNode(base + WORLD))
    graph.add(iri, HYDRA.template, Literal(f"{base}{POSES}{{?of,in}}"))
    for variable, predicate, required in (("of", LF.poseOf, True), ("in", LF.inFrame, False)):
        mapping = graph.blank(HYDRA.IriTemplateMapping)
        graph.add(iri, HYDRA.mapping, mapping)
        graph.add(mapping, HYDRA.variable, Literal(variable))
        graph.add(mapping, HYDRA.property, predicate)
        graph.add(mapping, HYDRA.required, Literal(required))


def describe_relative_pose(graph: Graph, iri: NamedNode, of: str, frame: str, posed: RelativePose) -> None:
    """Describe a relative pose; ``of`` and ``frame`` are IRIs."""
    graph.a(iri, LF.PoseInFrame)
    graph.add(iri, DCTERMS.title, Literal("Pose in a frame"))
    graph.add(iri, LF.poseOf, NamedNode(of))
    graph.add(iri, LF.inFrame, NamedNode(frame))
    describe_pose(graph, iri, posed.pose)
    if posed.involves_robot:
        graph.result_time(iri, posed.wall_ns)


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
    return form_of(LF.SceneObjectInput).with_choice("kind", RDF.type, _KINDS, "an obstacle by default")


def read_object(
    triples: Sequence[Triple],
    iri: str,
    world: str,
    present: SceneObject | None = None,
    described: frozenset[Triple] = frozenset(),
) -> StatedObject:
    """Parse an object for ``iri``, in place of ``present``, whose description is ``described``.

    Raises UnprocessableContent, which states the valid form.
    """
    body = validate_body(triples, LF.SceneObjectInput, iri, described)
    base = world.removesuffix(WORLD)
    frame, holder = (_path(body, predicate, base) for predicate in (LF.inFrame, LF.heldBy))
    types = body.nodes(body.root, RDF.type)
    if LF.Obstacle in types and LF.KeepOutZone in types:
        raise UnprocessableContent("An object is a lf:Obstacle or a lf:KeepOutZone, not both.")
    title, geometry, pose = body.text(body.root, DCTERMS.title), body.node(body.root, LF.geometry), read_pose(body)
    assert title is not None and geometry is not None
    _check_near(pose)
    _check_form(body, geometry, iri, present)
    kind: Kind = "zone" if LF.KeepOutZone in types else "obstacle"
    found = SceneObject(title=title, kind=kind, pose=pose, geometry=_geometry(body, geometry, iri, present))
    return StatedObject(found, frame or WORLD, holder)


def _path(body: Body, predicate: NamedNode, base: str) -> str:
    """Return the path of the thing that a body names, empty for none. Raises UnprocessableContent."""
    node = body.node(body.root, predicate)
    if node is not None and not (isinstance(node, NamedNode) and node.value.startswith(base + "/")):
        said = predicate.value.replace(LF.iri, "lf:")
        raise UnprocessableContent(f"{said} is the world or a link of a robot of this fleet, not {str(node)[:200]}.")
    return "" if node is None else node.value[len(base) :]


def _check_form(body: Body, node: Node, iri: str, present: SceneObject | None) -> None:
    """Refuse predicates of other types of geometry, which the common shape allows."""
    form = body.node(node, RDF.type)
    assert form is not None
    other = {each for said in PREDICATES_OF_GEOMETRY.values() for each in said}.difference(PREDICATES_OF_GEOMETRY[form])
    if present is None or any(each != NamedNode(iri + "/mesh") for each in body.nodes(node, LF.mesh)):
        other.add(LF.mesh)
    refuse_statements([t for t in body.triples if t.subject == node and t.predicate in other], f"{iri}/blueprint")


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
