"""Messages in the schemas of Foxglove, encoded by ``foxglove-sdk``; those of frames through templates. Pure; SI units.

A joint that nobody knows the position of has NaN, and a link whose pose is unknown no transform.
"""

import time
from collections.abc import Callable, Collection, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from linked_fleet_agent.wire.codec import WireError, layout, read_header
from linked_fleet_agent.wire.messages import Base
from linked_fleet_gateway.base.lazy_imports import Lazily
from linked_fleet_gateway.extensions.foxglove.template import Floats, Template, clamped
from linked_fleet_gateway.extensions.history.track import Joints, wall_ns
from linked_fleet_gateway.extensions.world.scene import Box, Cylinder, SceneObject, Sphere, TriangleMesh
from linked_fleet_gateway.fleet.invocation import Invocation
from linked_fleet_gateway.fleet.kinematics import ORIGIN, LinkPoses, compose, placed
from linked_fleet_gateway.fleet.model import Pose

if TYPE_CHECKING:
    from foxglove import Schema
    from foxglove import messages as fox
else:
    fox = Lazily("foxglove.messages", "foxglove")

WORLD_FRAME = "world"
STATES, TRANSFORMS, POSE = FRAMES = "joint_states", "tf", "pose"
LOG, EVENTS = "log", "invocations"
MESH_BYTES = 4 * 2**20
"""Bytes of all meshes in one message; a mesh for which there is no room is left out."""
Number = Callable[[], float]
_VALUES_AT = next(field.offset for field in layout(1, False) if field.name == "positions")
_BASE_VALUES = 13
_COLORS = {"obstacle": (0.5, 0.5, 0.55, 0.9), "zone": (0.9, 0.1, 0.1, 0.3)}


def schemas() -> "dict[str, Schema]":
    """The schemas of the channels that each robot has."""
    kinds: tuple[Any, ...] = (fox.JointStates, fox.FrameTransforms, fox.PoseInFrame, fox.Log, fox.Event)
    return {what: kind.get_schema() for what, kind in zip((*FRAMES, LOG, EVENTS), kinds, strict=True)}


def stamp_of(stamp_ns: int) -> "fox.Timestamp":
    return fox.Timestamp(*divmod(clamped(stamp_ns), 10**9))


class FrameEncoder:
    """Encodes the frames of one run of a robot. ``placement``: where its world is in the world, None if unknown;
    ``about``: the description that the ``joints`` are of; ``frame``: the one that was shown last."""

    def __init__(self, robot: str, joints: Joints, about: object = None) -> None:
        self._robot, self.joints, self.about = robot, joints, about
        self.frame: bytes | None = None
        self._due_s = 0.0
        self._states = Template(self._encode_states)
        self._linked: tuple[str, ...] = ()
        self._transforms = Template(lambda stamp_ns, number: b"")
        self._parent = ""

    def contents(
        self, frame: bytes, placement: Pose | None, every_s: float = 0.0, of: Collection[str] = FRAMES
    ) -> dict[str, bytes]:
        """Messages of a frame by channel, with transforms and poses every ``every_s`` alone. Raises WireError."""
        values, stamp_ns, now_s = self.values(frame), wall_ns(frame), time.monotonic()
        found = {STATES: self.joint_states(values, stamp_ns)} if STATES in of else {}
        if now_s >= self._due_s and (TRANSFORMS in of or POSE in of):
            self._due_s = max(self._due_s + every_s, now_s)
            if poses := self.poses(values, placement):
                found[TRANSFORMS] = self.transforms(poses, placement, stamp_ns)
                found[POSE] = self.pose(poses, placement, stamp_ns)
        return {what: content for what, content in found.items() if what in of}

    def values(self, frame: bytes) -> Floats:
        """The numbers of a frame. Raises WireError."""
        read_header(frame)
        count = _BASE_VALUES * self.joints.floating + 3 * len(self.joints.names)
        if len(frame) != _VALUES_AT + 8 * count:
            raise WireError(f"a frame of {len(frame)} bytes does not have {count} values")
        values = np.frombuffer(frame, "<f8", offset=_VALUES_AT)
        if np.isinf(values).any():
            raise WireError("a value is infinite")
        return values

    def joint_states(self, values: Floats, stamp_ns: int) -> bytes:
        rows = values[_BASE_VALUES * self.joints.floating :].reshape(3, len(self.joints.names))
        return self._states.fill(stamp_ns, rows.T.ravel())

    def poses(self, values: Floats, placement: Pose | None) -> dict[str, Pose]:
        """The poses of the links that are known, the root first."""
        joints = self.joints
        root, first = ORIGIN, _BASE_VALUES * joints.floating
        if joints.floating:
            b = values[:_BASE_VALUES].tolist()
            found = placed(Base(tuple(b[:3]), tuple(b[3:7]), tuple(b[7:10]), tuple(b[10:])))
            if found is None:
                return {}
            root = found
        positions = dict(zip(joints.names, values[first : first + len(joints.names)].tolist(), strict=True))
        links = LinkPoses(joints.model, positions, root if placement is None else compose(placement, root))
        poses = {link: links.of(link) for link in (joints.model.root, *joints.model.links)}
        return {link: pose for link, pose in poses.items() if pose is not None}

    def transforms(self, poses: Mapping[str, Pose], placement: Pose | None, stamp_ns: int) -> bytes:
        """All links in the frame of the world, or that of the robot's own world if nobody has placed it there."""
        linked, parent = tuple(poses), self._frame(placement)
        if (linked, parent) != (self._linked, self._parent):
            self._linked, self._parent = linked, parent
            self._transforms = Template(self._encode_transforms)
        numbers = [each for pose in poses.values() for each in (*pose.position_m, *pose.orientation_xyzw)]
        return self._transforms.fill(stamp_ns, np.array(numbers))

    def pose(self, poses: Mapping[str, Pose], placement: Pose | None, stamp_ns: int) -> bytes:
        """The pose of the root link."""
        pose = _pose(poses[self.joints.model.root])
        return fox.PoseInFrame(timestamp=stamp_of(stamp_ns), frame_id=self._frame(placement), pose=pose).encode()

    def _frame(self, placement: Pose | None) -> str:
        return f"{self._robot}/{WORLD_FRAME}" if placement is None else WORLD_FRAME

    def _encode_states(self, stamp_ns: int, number: Number) -> bytes:
        joints = [
            fox.JointState(name=name, position=number(), velocity=number(), effort=number())
            for name in self.joints.names
        ]
        return fox.JointStates(timestamp=stamp_of(stamp_ns), joints=joints).encode()

    def _encode_transforms(self, stamp_ns: int, number: Number) -> bytes:
        found = [
            fox.FrameTransform(
                timestamp=stamp_of(stamp_ns), parent_frame_id=self._parent, child_frame_id=f"{self._robot}/{link}",
                translation=fox.Vector3(x=number(), y=number(), z=number()),
                rotation=fox.Quaternion(x=number(), y=number(), z=number(), w=number()),
            )
            for link in self._linked
        ]  # fmt: skip
        return fox.FrameTransforms(transforms=found).encode()


def picture(frame_id: str, content: bytes, format: str, stamp_ns: int) -> bytes:
    return fox.CompressedImage(timestamp=stamp_of(stamp_ns), frame_id=frame_id, data=content, format=format).encode()


def log(robot: str, message: str, warning: bool, stamp_ns: int) -> bytes:
    level = fox.LogLevel.Warning if warning else fox.LogLevel.Info
    return fox.Log(timestamp=stamp_of(stamp_ns), level=level, message=message, name=robot).encode()


def event(robot: str, invocation: Invocation, stamp_ns: int) -> bytes:
    """An invocation as it is at ``stamp_ns``; of the fleet's ones the part of this robot."""
    said = {"robot": robot, "action": invocation.action, "state": invocation.robots.get(robot, invocation.state)}
    if invocation.robot == robot:
        said |= {"id": invocation.id, "client": invocation.client, "reason": invocation.reason}
        said |= {"progress": f"{invocation.progress:.2f}"}
    pairs = [fox.KeyValuePair(key=key, value=value) for key, value in said.items() if value]
    begin = stamp_of(invocation.created_ns)
    return fox.Event(start_time=begin, end_time=stamp_of(max(stamp_ns, invocation.created_ns)), metadata=pairs).encode()


def scene(objects: Mapping[str, SceneObject], stamp_ns: int) -> bytes:
    """All objects and zones, in place of those before."""
    stamp, room = stamp_of(stamp_ns), MESH_BYTES
    entities = list[fox.SceneEntity]()
    for id, thing in objects.items():
        said = [fox.KeyValuePair(key="title", value=thing.title), fox.KeyValuePair(key="kind", value=thing.kind)]
        size = len(thing.geometry.stl) if isinstance(thing.geometry, TriangleMesh) else 0
        if size > room:
            continue
        room -= size
        entities.append(
            fox.SceneEntity(timestamp=stamp, frame_id=WORLD_FRAME, id=id, metadata=said, **_primitives(thing))
        )
    gone = fox.SceneEntityDeletion(timestamp=stamp, type=fox.SceneEntityDeletionType.All)
    return fox.SceneUpdate(deletions=[gone], entities=entities).encode()


def _primitives(thing: SceneObject) -> dict[str, Any]:
    (r, g, b, a), form = _COLORS[thing.kind], thing.geometry
    pose, color = _pose(thing.pose), fox.Color(r=r, g=g, b=b, a=a)
    match form:
        case Box():
            x, y, z = form.size_m
            return {"cubes": [fox.CubePrimitive(pose=pose, size=fox.Vector3(x=x, y=y, z=z), color=color)]}
        case Sphere():
            width = 2 * form.radius_m
            cube = fox.Vector3(x=width, y=width, z=width)
            return {"spheres": [fox.SpherePrimitive(pose=pose, size=cube, color=color)]}
        case Cylinder():
            size = fox.Vector3(x=2 * form.radius_m, y=2 * form.radius_m, z=form.length_m)
            whole = fox.CylinderPrimitive(pose=pose, size=size, bottom_scale=1.0, top_scale=1.0, color=color)
            return {"cylinders": [whole]}
        case TriangleMesh():
            scale = fox.Vector3(x=1.0, y=1.0, z=1.0)
            model = fox.ModelPrimitive(
                pose=pose, scale=scale, color=color, override_color=True, media_type="model/stl", data=form.stl
            )
            return {"models": [model]}


def _pose(pose: Pose) -> "fox.Pose":
    (x, y, z), (i, j, k, w) = pose.position_m, pose.orientation_xyzw
    return fox.Pose(position=fox.Vector3(x=x, y=y, z=z), orientation=fox.Quaternion(x=i, y=j, z=k, w=w))
