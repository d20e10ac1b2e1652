"""The resources ``/{robot}/model`` and ``/{robot}/meshes/{file}``, and both with fewer triangles."""

from collections.abc import Callable, Mapping
from functools import partial

from msgspec import Struct
from starlette.responses import Response

from linked_fleet_agent.wire.messages import Mesh
from linked_fleet_base.errors import NotAcceptable
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
from linked_fleet_gateway.extensions.models.geometry import (
    MESHES,
    MODEL,
    SIMPLIFIED,
    SUFFIXES,
    file_name,
    mesh_path,
    meshes_of,
    model_path,
    simplified_name,
    simplified_path,
    urdf_with_mesh_addresses,
)
from linked_fleet_gateway.extensions.models.meshes import Meshes
from linked_fleet_gateway.extensions.models.simplified import SimplifiedMeshes
from linked_fleet_rdf.vocabulary import HYBRIT
from linked_fleet_rdf.vocabulary import LF as CORE

LF = CORE.extended("Model Mesh ModelShape MeshShape model mesh sha256 simplified SimplifiedModel SimplifiedModelShape")
MODEL_MEDIA_TYPE = "application/xml"
GLB = "model/gltf-binary"
_HEADERS = {"content-security-policy": "sandbox; default-src 'none'"}


class RemoteMesh(Struct, frozen=True):
    """A mesh that must be fetched from ``robot``; its metadata are known."""

    robot: Robot
    mesh: Mesh


class SimplifiedMesh(Struct, frozen=True):
    """The simplified form of a mesh of ``robot``."""

    robot: Robot
    mesh: Mesh


def _is_described(robot: Robot) -> bool:
    return robot.model is not None and robot.description is not None


def _resolve_model(view: RequestView, robot: Robot, rest: list[str]) -> Found:
    """Return the resource at the segments ``rest`` after ``model``."""
    if rest[:1] == [SIMPLIFIED]:
        model, shape, rest = _simplified_model(robot, view.base), LF.SimplifiedModelShape, rest[1:]
    else:
        model, shape = _model(robot, view.base), LF.ModelShape
    if rest == ["blueprint"]:
        return blueprint_of(model, view.base, (shape,))
    return None if rest else model


def _resolve_mesh(view: RequestView, robot: Robot, rest: list[str]) -> Found:
    """Return the resource at the segments ``rest`` after ``meshes``."""
    return _mesh(robot, rest[0]) if len(rest) == 1 else None


def _model(robot: Robot, base: str) -> Resource:
    describe, title = partial(_describe, robot=robot, base=base), f"Model of {robot.name}"
    return _document(robot, model_path(robot.name), title, describe, file_name)


def _simplified_model(robot: Robot, base: str) -> Resource:
    describe, title = partial(_describe_simplified, robot=robot, base=base), f"Simplified model of {robot.name}"
    return _document(robot, simplified_path(robot.name), title, describe, simplified_name)


def _document(
    robot: Robot, path: str, title: str, describe: Callable[[Graph], None], name_of: Callable[[Mesh], str]
) -> Resource:
    """Return the resource whose URDF names each mesh by the file name that ``name_of`` returns."""
    return Resource(
        path,
        title,
        describe,
        source=Source(lambda: robot.description, robot=robot),
        own_paths=(path + "/blueprint",),
        documents={MODEL_MEDIA_TYPE: lambda: _urdf(robot, name_of)},
    )


def _mesh(robot: Robot, name: str) -> Resource | None:
    said = robot.description.meshes if robot.description is not None else ()
    path, types = mesh_path(robot.name, name), (LDP.Resource, LDP.NonRDFSource)
    for mesh in said:
        if mesh.type not in SUFFIXES:
            continue
        if file_name(mesh) == name:
            return Resource(path, _title(mesh.uri), None, types, remote=RemoteMesh(robot, mesh), immutable=True)
        if simplified_name(mesh) == name:
            title = f"{_title(mesh.uri)}, simplified"
            return Resource(path, title, None, types, remote=SimplifiedMesh(robot, mesh))
    return None


def _urdf(robot: Robot, name_of: Callable[[Mesh], str]) -> bytes:
    addresses: Mapping[str, str] = {uri: mesh_path(robot.name, name_of(mesh)) for uri, mesh in meshes_of(robot).items()}
    return urdf_with_mesh_addresses(robot.description.urdf if robot.description is not None else "", addresses)


def _describe(graph: Graph, robot: Robot, base: str) -> None:
    path, title = model_path(robot.name), f"Model of {robot.name}"
    iri = _describe_document(graph, base + path, title, LF.Model, LF.ModelShape)
    graph.add(iri, RDFS.seeAlso, NamedNode(base + robot_path(robot.name)))
    graph.add(iri, LF.simplified, NamedNode(base + simplified_path(robot.name)))
    meshes = {NamedNode(base + mesh_path(robot.name, file_name(mesh))): mesh for mesh in meshes_of(robot).values()}
    graph.add(iri, LF.mesh, *meshes)
    for node, mesh in meshes.items():
        graph.a(node, LF.Mesh)
        graph.add(node, DCTERMS.title, Literal(_title(mesh.uri)))
        graph.add(node, DCTERMS.format, Literal(mesh.type))
        graph.add(node, LF.byteSize, integer(mesh.size))
        graph.add(node, LF.sha256, Literal(mesh.sha256))


def _describe_simplified(graph: Graph, robot: Robot, base: str) -> None:
    path, title = simplified_path(robot.name), f"Simplified model of {robot.name}"
    iri = _describe_document(graph, base + path, title, LF.SimplifiedModel, LF.SimplifiedModelShape)
    graph.add(iri, RDFS.seeAlso, NamedNode(base + model_path(robot.name)))


def _describe_document(graph: Graph, iri: str, title: str, kind: NamedNode, shape: NamedNode) -> NamedNode:
    node = NamedNode(iri)
    graph.a(node, kind)
    graph.add(node, DCTERMS.title, Literal(title))
    graph.add(node, DCTERMS.format, Literal(MODEL_MEDIA_TYPE))
    graph.add(node, HYBRIT.blueprint, shape, NamedNode(iri + "/blueprint"))
    return node


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


async def read_simplified_mesh(
    simplified: SimplifiedMeshes, request: Request, resource: Resource, remote: SimplifiedMesh
) -> Response:
    """Answer with the simplified mesh, or with 303 to the mesh itself if it cannot be simplified."""
    if choose(request.field("accept"), (GLB,)) is None:
        raise NotAcceptable(f"Available here: {GLB}.", offered=(GLB,))
    content = await simplified.get(remote.robot, remote.mesh)
    if content is None:
        location = request.base + mesh_path(remote.robot.name, file_name(remote.mesh))
        return Response(status_code=303, headers={"location": location, "cache-control": "no-store"})
    return content.response(request, Content.headers(request, resource, GLB) | _HEADERS)


BRANCHES = (
    RobotBranch(MODEL, LF.model, _resolve_model, _is_described),
    RobotBranch(MESHES, None, _resolve_mesh, _is_described),
)
