"""Messages in the schemas of Foxglove, encoded by ``foxglove-sdk``. Pure; SI units.

A joint with an unknown position gets NaN, and a link with an unknown pose gets no transform.
"""

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any

from linked_fleet_agent.wire.messages import State
from linked_fleet_base.lazy_imports import LazyModule
from linked_fleet_gateway.extensions.world.scene import Box, Cylinder, SceneObject, Sphere, TriangleMesh
from linked_fleet_state.invocation import Invocation
from linked_fleet_state.kinematics import LinkPoses, compose
from linked_fleet_state.model import Pose
from linked_fleet_state.robot import Robot
from linked_fleet_state.xml import Quaternion, Vector

if TYPE_CHECKING:
    import foxglove
    from foxglove import Schema
    from foxglove import messages as fox
else:
    foxglove, fox = LazyModule("foxglove", "foxglove"), LazyModule("foxglove.messages", "foxglove")

WORLD_FRAME = "world"
STATES, TRANSFORMS, POSE = FRAMES = "joint_states", "tf", "pose"
LOG, EVENTS = "log", "invocations"
OF_ROBOT = (*FRAMES, LOG, EVENTS)
SCENE, FLOOR, PICTURES, PART = "/world/objects", "/world/map", "cameras", "part"
LATEST_NS = 2**32 * 10**9 - 1
"""The latest time that a stamp of Foxglove can express, in 2106."""
MESH_BYTES = 4 * 2**20
"""Limit for all meshes in one message; a mesh that does not fit is left out."""
_COLORS = {"obstacle": (0.5, 0.5, 0.55, 0.9), "zone": (0.9, 0.1, 0.1, 0.3)}


def schemas() -> "dict[str, Schema]":
    """Return the schemas of messages by kind of channel."""
    of_robot = (fox.JointStates, fox.FrameTransforms, fox.PoseInFrame, fox.Log, fox.Event)
    kinds: tuple[Any, ...] = (*of_robot, fox.SceneUpdate, fox.Grid, fox.CompressedImage)
    return {what: kind.get_schema() for what, kind in zip((*OF_ROBOT, SCENE, FLOOR, PICTURES), kinds, strict=True)}


def json_schema(name: str, schema: bytes) -> "Schema":
    """Return the schema of a channel of JSON from a JSON Schema."""
    return foxglove.Schema(name=name, encoding="jsonschema", data=schema)


def joint_states(joints: Iterable[str], state: State) -> bytes:
    """Return a JointStates message. ``joints`` are the names in the order of the numbers of ``state``."""
    rows = zip(joints, state.positions, state.velocities, state.efforts, strict=True)
    found = [fox.JointState(name=name, position=p, velocity=v, effort=e) for name, p, v, e in rows]
    return fox.JointStates(timestamp=stamp_of(state.wall_ns), joints=found).encode()


def frame_of(robot: str, placement: Pose | None) -> str:
    """Return the name of the links' reference frame: the world, or the robot's own one without a placement."""
    return f"{robot}/{WORLD_FRAME}" if placement is None else WORLD_FRAME


def link_poses(robot: Robot, placement: Pose | None) -> dict[str, Pose]:
    """Return the known poses of links in ``frame_of``, the root first; empty while that of the root is unknown."""
    model = robot.model
    root = None if model is None else robot.link_pose(model.root)
    if model is None or root is None:
        return {}
    links = LinkPoses(model, robot.positions, root if placement is None else compose(placement, root))
    found = {link: links.pose(link) for link in (model.root, *model.links)}
    return {link: pose for link, pose in found.items() if pose is not None}


def transforms(robot: str, poses: Mapping[str, Pose], frame: str, stamp_ns: int) -> bytes:
    """Return a FrameTransforms message for ``poses`` of links in ``frame``."""
    stamp = stamp_of(stamp_ns)
    found = [
        fox.FrameTransform(
            timestamp=stamp,
            parent_frame_id=frame,
            child_frame_id=f"{robot}/{link}",
            translation=_vector(each.position_m),
            rotation=_quaternion(each.orientation_xyzw),
        )
        for link, each in poses.items()
    ]
    return fox.FrameTransforms(transforms=found).encode()


def pose(place: Pose, frame: str, stamp_ns: int) -> bytes:
    return fox.PoseInFrame(timestamp=stamp_of(stamp_ns), frame_id=frame, pose=_pose(place)).encode()


def picture(frame: str, content: bytes, format: str, stamp_ns: int) -> bytes:
    return fox.CompressedImage(timestamp=stamp_of(stamp_ns), frame_id=frame, data=content, format=format).encode()


def log(robot: str, message: str, warning: bool, stamp_ns: int) -> bytes:
    level = fox.LogLevel.Warning if warning else fox.LogLevel.Info
    return fox.Log(timestamp=stamp_of(stamp_ns), level=level, message=message, name=robot).encode()


def event(robot: str, invocation: Invocation, stamp_ns: int) -> bytes:
    """Return an invocation at ``stamp_ns`` as an event; for an invocation of the fleet, this robot's part."""
    said = {"robot": robot, "action": invocation.action, "state": invocation.robots.get(robot, invocation.state)}
    if invocation.robot == robot:
        said |= {"id": invocation.id, "client": invocation.client, "reason": invocation.reason}
        said |= {"progress": f"{invocation.progress:.2f}"}
    begin, end = stamp_of(invocation.created_ns), stamp_of(max(stamp_ns, invocation.created_ns))
    return fox.Event(start_time=begin, end_time=end, metadata=_pairs(said)).encode()


def scene(objects: Mapping[str, SceneObject], stamp_ns: int) -> bytes:
    """Return all objects and zones, replacing those before. What a link of a robot holds moves with its frame."""
    stamp, room, entities = stamp_of(stamp_ns), MESH_BYTES, list[fox.SceneEntity]()
    for id, thing in objects.items():
        size = len(thing.geometry.stl) if isinstance(thing.geometry, TriangleMesh) else 0
        if size <= room:
            room -= size
            said = _pairs({"title": thing.title, "kind": thing.kind})
            frame = WORLD_FRAME if thing.held is None else f"{thing.held.robot}/{thing.held.link}"
            more = {"frame_id": frame, "frame_locked": thing.held is not None, **_primitives(thing)}
            entities.append(fox.SceneEntity(timestamp=stamp, id=id, metadata=said, **more))
    gone = fox.SceneEntityDeletion(timestamp=stamp, type=fox.SceneEntityDeletionType.All)
    return fox.SceneUpdate(deletions=[gone], entities=entities).encode()


def _primitives(thing: SceneObject) -> dict[str, Any]:
    (r, g, b, a), form = _COLORS[thing.kind], thing.geometry
    place = thing.pose if thing.held is None else thing.held.pose
    look: dict[str, Any] = {"pose": _pose(place), "color": fox.Color(r=r, g=g, b=b, a=a)}
    match form:
        case Box():
            return {"cubes": [fox.CubePrimitive(size=_vector(form.size_m), **look)]}
        case Sphere():
            return {"spheres": [fox.SpherePrimitive(size=_vector((2 * form.radius_m,) * 3), **look)]}
        case Cylinder():
            size = _vector((2 * form.radius_m, 2 * form.radius_m, form.length_m))
            return {"cylinders": [fox.CylinderPrimitive(size=size, bottom_scale=1.0, top_scale=1.0, **look)]}
        case TriangleMesh():
            look |= {"scale": _vector((1.0, 1.0, 1.0)), "override_color": True}
            return {"models": [fox.ModelPrimitive(media_type="model/stl", data=form.stl, **look)]}


def _pairs(said: Mapping[str, str]) -> "list[fox.KeyValuePair]":
    """Return the pairs that have a value."""
    return [fox.KeyValuePair(key=key, value=value) for key, value in said.items() if value]


def stamp_of(stamp_ns: int) -> "fox.Timestamp":
    """Return the stamp, limited to what a message can express: the clock of a robot may have any value."""
    return fox.Timestamp(*divmod(min(max(stamp_ns, 0), LATEST_NS), 10**9))


def _pose(pose: Pose) -> "fox.Pose":
    return fox.Pose(position=_vector(pose.position_m), orientation=_quaternion(pose.orientation_xyzw))


def _vector(value: Vector) -> "fox.Vector3":
    x, y, z = value
    return fox.Vector3(x=x, y=y, z=z)


def _quaternion(value: Quaternion) -> "fox.Quaternion":
    x, y, z, w = value
    return fox.Quaternion(x=x, y=y, z=z, w=w)
