"""The resources ``/{robot}/model`` and ``/{robot}/meshes/{file}``."""

from msgspec import Struct
from starlette.responses import Response

from linked_fleet_agent.wire.messages import Mesh
from linked_fleet_gateway.api import (
    DCTERMS,
    LDP,
    RDFS,
    Content,
    Found,
    Graph,
    Literal,
    NamedNode,
    Request,
    RequestView,
    Resource,
    Robot,
    RobotBranch,
    Source,
    blueprint_of,
    choose,
    integer,
    robot_path,
)  # fmt: skip
from linked_fleet_gateway.base.errors import NotAcceptable
from linked_fleet_gateway.extensions.models.geometry import (
    MESHES,
    MODEL,
    SUFFIXES,
    file_name,
    mesh_path,
    meshes_of,
    model_path,
    urdf_with_mesh_addresses,
)
from linked_fleet_gateway.extensions.models.meshes import Meshes
from linked_fleet_gateway.rdf.vocabulary import HYBRIT
from linked_fleet_gateway.rdf.vocabulary import LF as CORE

LF = CORE.extended("Model Mesh ModelShape MeshShape model mesh sha256")
MODEL_MEDIA_TYPE = "application/xml"
# A browser that takes a foreign mesh for a document must not execute anything.
_HEADERS = {"content-security-policy": "sandbox; default-src 'none'"}


class RemoteMesh(Struct, frozen=True):
    """A mesh that must be fetched from ``robot``; its metadata are known."""

    robot: Robot
    mesh: Mesh


def _is_described(robot: Robot) -> bool:
    return robot.model is not None and robot.description is not None


def _resolve_model(view: RequestView, robot: Robot, rest: list[str]) -> Found:
    """Return the resource at the segments ``rest`` after ``model``."""
    model = _model(robot, view.base)
    if rest == ["blueprint"]:
        return blueprint_of(model, view.base, (LF.ModelShape,))
    return None if rest else model


def _resolve_mesh(view: RequestView, robot: Robot, rest: list[str]) -> Found:
    """Return the resource at the segments ``rest`` after ``meshes``."""
    return _mesh(robot, rest[0]) if len(rest) == 1 else None


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


async def read_mesh(meshes: Meshes, request: Request, resource: Resource, remote: RemoteMesh) -> Response:
    """Answer from the known size and digest, and query the robot only if the bytes are needed."""
    mesh = remote.mesh
    if choose(request.field("accept"), (mesh.type,)) is None:
        raise NotAcceptable(f"Available here: {mesh.type}.", offered=(mesh.type,))
    headers = Content.headers(request, resource, mesh.type) | _HEADERS
    headers |= {"etag": f'"{mesh.sha256}"', "content-length": str(mesh.size)}
    if (known := Content.known(request, headers)) is not None:
        return known
    content = b"" if request.method == "HEAD" else await meshes.get(remote.robot, mesh)
    return Response(content, headers=headers)


BRANCHES = (
    RobotBranch(MODEL, LF.model, _resolve_model, _is_described),
    RobotBranch(MESHES, None, _resolve_mesh, _is_described),
)
