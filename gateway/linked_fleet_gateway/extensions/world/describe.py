"""The world as triples: placements of robots, and objects. Pure."""

from collections.abc import Iterable, Mapping

from pyoxigraph import Literal, NamedNode

from linked_fleet_gateway.extensions.world.placement import PLACEMENT, WORLD, describe_pose, placement_of
from linked_fleet_gateway.extensions.world.scene import Box, Cylinder, Geometry, SceneObject, Sphere
from linked_fleet_gateway.extensions.world.terms import LF
from linked_fleet_gateway.fleet.robot import Robot
from linked_fleet_gateway.rdf.graph import Graph, Node
from linked_fleet_gateway.rdf.units import METRE
from linked_fleet_gateway.rdf.vocabulary import DCTERMS, HYBRIT, HYDRA, LDP, RDFS
from linked_fleet_gateway.resources.paths import link_path, model_path, robot_path
from linked_fleet_gateway.resources.relative_poses import RelativePose

OBJECTS, POSES = f"{WORLD}/objects", f"{WORLD}/pose"
STL = "model/stl"
MAX_DESCRIBED = 100
"""Objects that the container describes; others are only listed."""
Objects = Mapping[str, SceneObject]


def object_path(id: str) -> str:
    return f"{OBJECTS}/{id}"


def describe_world(graph: Graph, base: str, robots: Iterable[Robot]) -> None:
    """Describe the frame tree down to the root links, where the joints of each robot continue it."""
    robots = sorted(robots, key=lambda robot: robot.name)
    describe_frame(graph, base, robots)
    for robot in robots:
        _describe_robot(graph, base, robot)


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
    describe_pose(graph, placement, placement_of(robot))
    graph.add(placement, LF.inFrame, NamedNode(base + WORLD))


def describe_objects(graph: Graph, base: str, objects: Objects, most: int = MAX_DESCRIBED) -> None:
    """Describe the LDP container of the objects; the first ``most``, by title, are described completely."""
    iri = NamedNode(base + OBJECTS)
    graph.a(iri, LF.SceneObjects, LDP.BasicContainer, LDP.Container)
    graph.add(iri, DCTERMS.title, Literal("Objects of the world"))
    graph.add(iri, RDFS.seeAlso, NamedNode(base + WORLD))
    graph.add(iri, LDP.constrainedBy, LF.SceneObjectInput)
    graph.add(iri, HYBRIT.blueprint, LF.SceneObjectsShape, NamedNode(iri.value + "/blueprint"))
    ordered = sorted(objects.items(), key=lambda each: (each[1].title, each[0]))
    graph.add(iri, LDP.contains, *(NamedNode(base + object_path(id)) for id, _ in ordered))
    for id, thing in ordered[:most]:
        describe_object(graph, base, id, thing)


def describe_object(graph: Graph, base: str, id: str, thing: SceneObject) -> None:
    iri = NamedNode(base + object_path(id))
    graph.a(iri, LF.SceneObject, LF.Obstacle if thing.kind == "obstacle" else LF.KeepOutZone)
    graph.add(iri, DCTERMS.title, Literal(thing.title))
    graph.add(iri, RDFS.seeAlso, NamedNode(base + OBJECTS))
    graph.add(iri, HYBRIT.blueprint, LF.SceneObjectShape, NamedNode(iri.value + "/blueprint"))
    describe_pose(graph, iri, thing.pose)
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


def describe_posed(graph: Graph, iri: NamedNode, of: str, frame: str, posed: RelativePose) -> None:
    """Describe a relative pose; ``of`` and ``frame`` are IRIs."""
    graph.a(iri, LF.PoseInFrame)
    graph.add(iri, DCTERMS.title, Literal("Pose in a frame"))
    graph.add(iri, LF.poseOf, NamedNode(of))
    graph.add(iri, LF.inFrame, NamedNode(frame))
    describe_pose(graph, iri, posed.pose)
    if posed.moves:
        graph.result_time(iri, posed.wall_ns)
