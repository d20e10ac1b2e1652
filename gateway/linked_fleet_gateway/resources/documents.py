"""Documents of the gateway and of robots: vocabulary, JSON-LD context, models and their meshes (desideratum D5)."""

import json
from collections.abc import Iterable, Iterator
from functools import partial

from pyoxigraph import Literal, NamedNode, Triple

from linked_fleet_gateway.fleet.geometry import SUFFIXES, file_name, meshes_of, urdf_with_mesh_addresses
from linked_fleet_gateway.fleet.robot import Robot
from linked_fleet_gateway.rdf import shapes
from linked_fleet_gateway.rdf.graph import Graph, integer
from linked_fleet_gateway.rdf.vocabulary import DCTERMS, HYBRIT, LDP, LF, OWL, PREFIXES, RDF, RDFS
from linked_fleet_gateway.resources.description import InSteps
from linked_fleet_gateway.resources.paths import mesh_path, model_path, robot_path
from linked_fleet_gateway.resources.resource import RemoteMesh, Resource, blueprint_of
from linked_fleet_gateway.resources.versioning import Source

VOCABULARY = "/vocabulary"
_DESCRIBES = (RDF.type, RDFS.label, RDFS.comment)


def vocabulary_resource(base: str) -> Resource:
    steps = partial(_vocabulary, base)
    return Resource(VOCABULARY, "Vocabulary", InSteps(steps), source=Source(shown=tuple))


def context_resource() -> Resource:
    content = json.dumps({"@context": PREFIXES}, indent=1).encode()
    document = {"application/ld+json": lambda: content}
    return Resource("/context", "JSON-LD context", None, (LDP.Resource,), documents=document)


def describe_terms(base: str, graph: Graph) -> Iterator[None]:
    """Add all our own terms, and the shapes of bodies that containers accept."""
    iri = NamedNode(base + VOCABULARY)
    graph.a(iri, OWL.Ontology, LDP.RDFSource)
    graph.add(iri, DCTERMS.title, Literal("Terms and shapes of Linked Fleet"))
    graph.add(iri, RDFS.seeAlso, NamedNode(base + "/"))
    for name in (shapes.VOCABULARY, shapes.SUBSCRIPTIONS):
        for triples in shapes.load_turtle(name).values():
            _add(graph, triples)
            yield


def _vocabulary(base: str, graph: Graph) -> Iterator[None]:
    """Add all our own terms, and all shapes that any document names.

    Shapes of request bodies are included completely. Other blueprint shapes are only named and typed: each resource
    links the blueprint with its own shape, and as class targets they would also apply to requests and to things that a
    document only mentions.
    """
    yield from describe_terms(base, graph)
    for node, triples in shapes.load_turtle(shapes.BLUEPRINTS).items():
        if isinstance(node, NamedNode):
            _add(graph, (triple for triple in triples if triple.predicate in _DESCRIBES))
            if node.value.endswith("Input"):
                shapes.add_closure(graph, node)
            yield


def _add(graph: Graph, triples: Iterable[Triple]) -> None:
    for triple in triples:
        graph.add(triple.subject, triple.predicate, triple.object)  # type: ignore[arg-type]


MODEL_MEDIA_TYPE = "application/xml"


def resolve_geometry(robot: Robot, rest: list[str], base: str) -> Resource | None:
    """Resolve ``rest``, the segments below the robot. None without a description of the robot."""
    if robot.model is None or robot.description is None:
        return None
    if rest[0] == "model":
        model = _model(robot, base)
        if rest[1:] == ["blueprint"]:
            return blueprint_of(model, base, (LF.ModelShape,))
        return None if rest[1:] else model
    return _mesh(robot, rest[1]) if rest[0] == "meshes" and len(rest) == 2 else None


def _model(robot: Robot, base: str) -> Resource:
    path = model_path(robot.name)
    return Resource(
        path,
        f"Model of {robot.name}",
        lambda graph: _describe(graph, robot, base),
        source=Source(lambda: robot.description, robot=robot),
        own_paths=(path + "/blueprint",),
        documents={MODEL_MEDIA_TYPE: lambda: _urdf(robot)},
    )


def _mesh(robot: Robot, name: str) -> Resource | None:
    said = robot.description.meshes if robot.description is not None else ()
    mesh = next((each for each in said if each.type in SUFFIXES and file_name(each) == name), None)
    if mesh is None:
        return None
    path = mesh_path(robot.name, name)
    types = (LDP.Resource, LDP.NonRDFSource)
    return Resource(path, _title(mesh.uri), None, types, remote=RemoteMesh(robot, mesh), immutable=True)


def _urdf(robot: Robot) -> bytes:
    addresses = {uri: mesh_path(robot.name, file_name(mesh)) for uri, mesh in meshes_of(robot).items()}
    return urdf_with_mesh_addresses(robot.description.urdf if robot.description is not None else "", addresses)


def _describe(graph: Graph, robot: Robot, base: str) -> None:
    iri = NamedNode(base + model_path(robot.name))
    graph.a(iri, LF.Model)
    graph.add(iri, DCTERMS.title, Literal(f"Model of {robot.name}"))
    graph.add(iri, DCTERMS.format, Literal(MODEL_MEDIA_TYPE))
    graph.add(iri, RDFS.seeAlso, NamedNode(base + robot_path(robot.name)))
    graph.add(iri, HYBRIT.blueprint, LF.ModelShape, NamedNode(iri.value + "/blueprint"))
    meshes = {NamedNode(base + mesh_path(robot.name, file_name(mesh))): mesh for mesh in meshes_of(robot).values()}
    graph.add(iri, LF.mesh, *meshes)
    for node, mesh in meshes.items():
        graph.a(node, LF.Mesh)
        graph.add(node, DCTERMS.title, Literal(_title(mesh.uri)))
        graph.add(node, DCTERMS.format, Literal(mesh.type))
        graph.add(node, LF.byteSize, integer(mesh.size))
        graph.add(node, LF.sha256, Literal(mesh.sha256))


def _title(uri: str) -> str:
    """Return the file name, or the whole URI if that is empty."""
    return uri.rpartition("/")[2] or uri
