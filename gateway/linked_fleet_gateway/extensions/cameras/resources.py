"""Cameras as properties of their robot (desideratum D5): their RDF, their terms and their pictures.

The RDF of a camera does not describe its pictures, so it changes only with its robot. A picture is cached only while a
client follows it; otherwise a GET queries the robot.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import partial

from pyoxigraph import Literal, NamedNode

from linked_fleet_agent.wire.messages import Camera
from linked_fleet_gateway.api import (
    CONTAINER,
    FleetBranch,
    RequestView,
    Resource,
    RobotBranch,
    Source,
    blueprint_of,
    link_path,
    robot_path,
)
from linked_fleet_gateway.extensions.cameras.cameras import (
    FORMATS,
    SEGMENT,
    Picture,
    camera_path,
    cameras_of,
    cameras_path,
    types_of,
)
from linked_fleet_gateway.faces import Describer
from linked_fleet_gateway.resources.binary_frames import FRAME_TYPES, Field, add_field, describe_layout, layout_path
from linked_fleet_rdf.graph import HERTZ, METRE, RADIAN, Graph, integer
from linked_fleet_rdf.serialise import NoContentYet
from linked_fleet_rdf.vocabulary import DCTERMS, HYBRIT, LDP, QUDT, RDFS, SOSA
from linked_fleet_rdf.vocabulary import LF as CORE
from linked_fleet_state.model import Link
from linked_fleet_state.observation import Observation
from linked_fleet_state.robot import Robot

LF = CORE.extended(
    "Camera Cameras FleetCameras CameraShape CamerasShape FleetCamerasShape cameras allCameras imageWidth"
    " imageHeight verticalFieldOfView nearest farthest maximumRate picture"
)

PATH = "/" + SEGMENT
_WALL = "the list of all cameras"
MAX_RATE_HZ = 10.0
"""Highest rate of queries to one camera, however many clients want its pictures."""
_DEPTH_HEADER = (
    Field("magic", "char2", 0, "The letters LD."),
    Field("version", "uint16", 2, "Version of this frame layout: 1."),
    Field("rows", "uint16", 4, "Number of rows of depths."),
    Field("columns", "uint16", 6, "Number of depths in a row."),
    Field("incarnation", "uint64", 8, "The run of the agent, as in lf:version."),
    Field("sequence", "uint64", 16, "Number of the state frame shown, counted from 0: one less than in lf:version."),
    Field("monotonic_ns", "int64", 24, "Time of that state by the agent's monotonic clock."),
    Field("wall_ns", "int64", 32, "Time of that state by the agent's wall clock, since 1970 (UTC)."),
    Field("near_m", "float64", 40, "Lower bound of all depths."),
    Field("far_m", "float64", 48, "Upper bound of all depths."),
)
_DEPTHS = Field(
    "depth", "float32", 56,
    "Distances along the optical axis, row by row from the top; NaN where nothing is in range.",
)  # fmt: skip

Held = Callable[[str, str], dict[str, Picture]]
"""Returns the last pictures of a followed camera by format, given the names of robot and camera."""


@dataclass(frozen=True)
class RobotCamera:
    """A camera of ``robot``, which is queried for pictures."""

    robot: Robot
    camera: Camera


def mounted_cameras(robot: Robot, link: Link) -> list[tuple[NamedNode, str]]:
    """Return the cameras that are mounted on a link."""
    mounted = [each.name for each in cameras_of(robot).values() if each.link == link.name]
    return [(SOSA.hosts, camera_path(robot.name, name)) for name in mounted]


def cameras_branch(held: Held) -> RobotBranch:
    """Return the branch ``/{robot}/cameras`` with its cameras."""

    def resolve(view: RequestView, robot: Robot, rest: list[str]) -> Resource | None:
        return _resolve(held, view, robot, rest)

    return RobotBranch(SEGMENT, LF.cameras, resolve, lambda robot: bool(cameras_of(robot)))


def wall_branch() -> FleetBranch:
    """Return the branch ``/cameras``: the cameras of all robots that the caller sees."""

    def resolve(view: RequestView, rest: list[str]) -> Resource | None:
        found = _wall(view)
        if rest == ["blueprint"]:
            return blueprint_of(found, view.base, (LF.FleetCamerasShape,), found.source)
        return None if rest else found

    return FleetBranch(SEGMENT, LF.allCameras, resolve)


def _wall(view: RequestView) -> Resource:
    found = list[tuple[Robot, dict[str, Camera]]]()
    for robot in view.robots.values():
        with view.faults.guard(_WALL, robot.name):
            if cameras := cameras_of(robot):
                found.append((robot, cameras))

    def describe(graph: Graph) -> None:
        iri = view.iri(PATH)
        graph.a(iri, LF.FleetCameras, LDP.BasicContainer, LDP.Container)
        graph.add(iri, DCTERMS.title, Literal("Cameras"))
        graph.add(iri, RDFS.seeAlso, view.iri("/"))
        graph.add(iri, HYBRIT.blueprint, LF.FleetCamerasShape, NamedNode(iri.value + "/blueprint"))
        for robot, cameras in found:
            for camera in cameras.values():
                _describe_member(graph, view, iri, robot, camera)
                member = view.iri(camera_path(robot.name, camera.name))
                graph.add(member, LF.ofRobot, view.iri(robot_path(robot.name)))

    source = Source(lambda: [(robot.name, robot.description) for robot, _ in found])
    members = tuple(camera_path(robot.name, name) for robot, cameras in found for name in cameras)
    own = (PATH + "/blueprint",)
    return Resource(PATH, "Cameras", describe, CONTAINER, source, own_paths=own, part_paths=members)


def _resolve(held: Held, view: RequestView, robot: Robot, rest: list[str]) -> Resource | None:
    cameras = cameras_of(robot)
    if not rest:
        return _container(view, robot, cameras)
    if rest == ["blueprint"]:
        return blueprint_of(_container(view, robot, cameras), view.base, (LF.CamerasShape,), _said(robot))
    path = f"{cameras_path(robot.name)}/{rest[0]}"
    camera = next((each for each in cameras.values() if camera_path(robot.name, each.name) == path), None)
    if camera is None:
        return None
    source = _camera(held, view, robot, camera)
    if not rest[1:]:
        return source
    if rest[1:] == ["blueprint"]:
        return blueprint_of(source, view.base, (LF.CameraShape,), _said(robot))
    return _in_layout(view, robot, camera, rest[2:]) if source.layout_path and rest[1] == "layout" else None


def _container(view: RequestView, robot: Robot, cameras: dict[str, Camera]) -> Resource:
    path = cameras_path(robot.name)
    members = tuple(camera_path(robot.name, name) for name in cameras)
    return Resource(
        path,
        f"Cameras of {robot.name}",
        lambda graph: _describe_all(graph, view, robot, cameras.values()),
        CONTAINER,
        source=_said(robot),
        own_paths=(path + "/blueprint",),
        part_paths=members,
    )


def _camera(held: Held, view: RequestView, robot: Robot, camera: Camera) -> Resource:
    path = camera_path(robot.name, camera.name)
    types = types_of(camera)

    def seen() -> dict[str, Picture]:
        found = held(robot.name, camera.name)
        return {format: each for format, each in found.items() if each.moment.incarnation == robot.incarnation}

    def look() -> tuple[Observation, ...]:
        moments = [(format, picture.moment) for format, picture in sorted(seen().items())]
        return tuple(Observation((float(at.sequence),), at.wall_ns, at.sequence) for _, at in moments)

    return Resource(
        path,
        f"Camera {camera.name} of {robot.name}",
        partial(_describe, view=view, robot=robot, camera=camera),
        source=Source(lambda: (robot.presence_facts, robot.description), look, robot),
        own_paths=(path + "/blueprint",),
        documents={each: partial(_content, seen, path, FORMATS[each]) for each in types},
        remote=RobotCamera(robot, camera),
        values_only_in_documents=True,
        layout_path=layout_path(path) if FRAME_TYPES[0] in types else None,
    )


def _content(seen: Callable[[], dict[str, Picture]], path: str, format: str) -> bytes:
    picture = seen().get(format)
    if picture is None:
        raise NoContentYet(f"no picture of {path} has been taken yet")
    return picture.content


def _said(robot: Robot) -> Source:
    return Source(lambda: robot.description, robot=robot)


def _describe_all(graph: Graph, view: RequestView, robot: Robot, cameras: Iterable[Camera]) -> None:
    iri = view.iri(cameras_path(robot.name))
    graph.a(iri, LF.Cameras, LDP.BasicContainer, LDP.Container)
    graph.add(iri, DCTERMS.title, Literal(f"Cameras of {robot.name}"))
    graph.add(iri, RDFS.seeAlso, view.iri(robot_path(robot.name)))
    graph.add(iri, HYBRIT.blueprint, LF.CamerasShape, NamedNode(iri.value + "/blueprint"))
    for camera in cameras:
        _describe_member(graph, view, iri, robot, camera)


def _describe_member(graph: Graph, view: RequestView, container: NamedNode, robot: Robot, camera: Camera) -> None:
    member = view.iri(camera_path(robot.name, camera.name))
    graph.add(container, LDP.contains, member)
    graph.a(member, LF.Camera)
    graph.add(member, DCTERMS.title, Literal(camera.name))
    graph.add(member, LF.reason, *_reason(camera))


def _describe(graph: Graph, view: RequestView, robot: Robot, camera: Camera) -> None:
    assert robot.model is not None
    iri, types = view.iri(camera_path(robot.name, camera.name)), types_of(camera)
    graph.a(iri, LF.Camera, SOSA.Sensor, HYBRIT.Property)
    graph.add(iri, DCTERMS.title, Literal(f"camera {camera.name} of {robot.name}"))
    graph.add(iri, RDFS.seeAlso, view.iri(robot_path(robot.name)))
    graph.add(iri, HYBRIT.blueprint, LF.CameraShape, NamedNode(iri.value + "/blueprint"))
    graph.add(iri, SOSA.isHostedBy, view.iri(link_path(robot.name, robot.model, camera.link)))
    graph.vector(iri, LF.position, camera.position_m, METRE)
    graph.quaternion(iri, LF.orientation, camera.orientation_xyzw)
    graph.add(iri, LF.imageWidth, integer(camera.width))
    graph.add(iri, LF.imageHeight, integer(camera.height))
    graph.scalar(iri, LF.verticalFieldOfView, camera.vertical_fov_rad, RADIAN)
    graph.scalar(iri, LF.nearest, camera.near_m, METRE)
    graph.scalar(iri, LF.farthest, camera.far_m, METRE)
    graph.scalar(iri, LF.maximumRate, MAX_RATE_HZ if types else None, HERTZ)
    graph.add(iri, LF.picture, iri if types else LF.unknown)
    graph.add(iri, DCTERMS.format, *map(Literal, types))
    graph.add(iri, LF.reason, *_reason(camera))
    if not robot.online:
        Describer(view.base).presence(graph, iri, robot)


def _reason(camera: Camera) -> list[Literal]:
    """Return why a camera has no pictures; nothing if it has."""
    if types_of(camera):
        return []
    return [Literal(camera.unavailable or "The robot offers no picture format that this gateway supports.")]


def _in_layout(view: RequestView, robot: Robot, camera: Camera, rest: Sequence[str]) -> Resource | None:
    about = view.iri(camera_path(robot.name, camera.name))
    path = layout_path(camera_path(robot.name, camera.name))
    layout = Resource(
        path,
        f"Layout of the depths that {camera.name} sees",
        lambda graph: _describe_layout(graph, about, camera),
        source=_said(robot),
        own_paths=(path + "/blueprint",),
    )
    if rest == ["blueprint"]:
        return blueprint_of(layout, view.base, (LF.FrameLayoutShape,), _said(robot))
    return None if rest else layout


def _describe_layout(graph: Graph, about: NamedNode, camera: Camera) -> None:
    count = camera.width * camera.height
    iri = describe_layout(graph, about, f"the depths that {camera.name} sees", _DEPTHS.offset + 4 * count)
    for each in _DEPTH_HEADER:
        add_field(graph, iri, each)
    graph.add(add_field(graph, iri, _DEPTHS, count), QUDT.unit, METRE.qudt)
