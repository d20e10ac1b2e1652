"""Encoders: each message is decoded by its own schema, and contains the input."""

import math
import struct
from collections.abc import Mapping
from typing import Any

import msgspec
import pytest
from foxglove import messages as fox
from msgspec.structs import replace

from foxglove_messages import decoded
from linked_fleet_agent.wire.codec import encode_state, layout
from linked_fleet_agent.wire.messages import Base, State
from linked_fleet_gateway.extensions.foxglove import messages
from linked_fleet_gateway.extensions.foxglove.messages import LATEST_NS
from linked_fleet_gateway.extensions.world.scene import Box, Cylinder, Held, Kind, SceneObject, Sphere, TriangleMesh
from linked_fleet_state.events import Described, Framed
from linked_fleet_state.invocation import Invocation, InvocationState
from linked_fleet_state.model import Pose

_JOINTS = {
    "pan": ("revolute", '<origin xyz="0 0 1"/><limit lower="-2" upper="2" velocity="1" effort="1"/>'),
    "lift": ("prismatic", '<limit lower="0" upper="1" velocity="1" effort="1"/>'),
    "lost": ("floating", ""),
}
STAMP_NS = 1_700_000_000_000_000_007
AT = Pose((1.0, 2.0, 3.0), (0.0, 0.0, 0.0, 1.0))


def read(kind: Any, content: bytes) -> Any:
    schema = kind.get_schema()
    assert schema.encoding == "protobuf"
    return decoded(schema.name, schema.data, content)


def state(positions: tuple[float, ...], base: Base | None = None, run: int = 1) -> State:
    return State(
        incarnation=run, sequence=9, monotonic_ns=1, wall_ns=STAMP_NS, positions=positions,
        velocities=(0.0,) * len(positions), efforts=(math.nan,) * len(positions), base=base,
    )  # fmt: skip


def test_joint_states_have_a_name_and_three_numbers_for_each_joint() -> None:
    for positions in ((0.5, 0.25), (0.0, math.nan)):
        states = read(fox.JointStates, messages.joint_states(("pan", "lift"), state(positions)))
        assert (states.timestamp.seconds, states.timestamp.nanos) == divmod(STAMP_NS, 10**9)
        assert [each.name for each in states.joints] == ["pan", "lift"]
        assert [each.position for each in states.joints] == pytest.approx(list(positions), nan_ok=True)
        assert [each.velocity for each in states.joints] == [0.0, 0.0]
        assert all(math.isnan(each.effort) for each in states.joints)


def transforms(bench: Any, positions: tuple[float, ...], placement: Pose | None) -> Mapping[str, Any]:
    poses = messages.link_poses(bench.robot(_JOINTS, positions), placement)
    content = messages.transforms("r", poses, messages.frame_of("r", placement), STAMP_NS)
    found = read(fox.FrameTransforms, content).transforms
    assert all(each.timestamp.seconds == STAMP_NS // 10**9 for each in found)
    return {each.child_frame_id: each for each in found}


def vector(each: Any) -> tuple[float, ...]:
    return each.translation.x, each.translation.y, each.translation.z


def test_transforms_are_of_all_links_whose_pose_is_known(bench: Any) -> None:
    found = transforms(bench, (math.pi / 2, 0.5), AT)
    assert set(found) == {"r/base", "r/pan_link", "r/lift_link"}
    assert {each.parent_frame_id for each in found.values()} == {"world"}
    assert vector(found["r/base"]) == (1.0, 2.0, 3.0)
    assert vector(found["r/lift_link"]) == pytest.approx((1.0, 2.0, 4.5))
    assert found["r/pan_link"].rotation.z == pytest.approx(math.sqrt(0.5))
    assert set(transforms(bench, (0.0, math.nan), AT)) == {"r/base", "r/pan_link"}
    assert set(transforms(bench, (0.0, 0.0), AT)) == {"r/base", "r/pan_link", "r/lift_link"}


def test_a_robot_without_placement_has_a_frame_of_its_own(bench: Any) -> None:
    found = transforms(bench, (0.0, 0.0), None)
    assert {each.parent_frame_id for each in found.values()} == {"r/world"}
    assert vector(found["r/base"]) == (0.0, 0.0, 0.0)


def test_the_base_of_a_floating_robot_is_placed(bench: Any) -> None:
    robot, still = bench.robot({"pan": ("continuous", "")}, None), (0.0, 0.0, 0.0)
    changed = msgspec.structs.replace(robot.description, base="floating", layout=layout(1, True))
    bench.fleet.apply(Described(changed), 1)

    def poses(position: tuple[float, float, float], sequence: int) -> dict[str, Pose]:
        base = Base(position, (0.0, 0.0, 0.0, 2.0), still, still)
        one = msgspec.structs.replace(state((0.0,), base, robot.incarnation), sequence=sequence)
        bench.fleet.apply(Framed("r", encode_state(one)), 1)
        return messages.link_poses(robot, AT)

    found = poses((0.5, 0.0, 0.0), 1)
    pose = read(fox.PoseInFrame, messages.pose(found["base"], messages.frame_of("r", AT), STAMP_NS))
    assert (pose.frame_id, pose.pose.position.x, pose.pose.orientation.w) == ("world", 1.5, 1.0)
    assert poses((math.nan,) * 3, 2) == {}  # type: ignore[arg-type]


def test_a_frame_with_an_infinite_value_is_ignored(bench: Any) -> None:
    robot = bench.robot(_JOINTS, None)
    good = encode_state(state((0.0, 0.0), run=robot.incarnation))
    bench.fleet.apply(Framed("r", good[:-8] + struct.pack("<d", math.inf)), 1)
    assert robot.payload is not None and robot.frame is None
    assert messages.link_poses(robot, AT) == {}


@pytest.mark.parametrize(("stamp_ns", "said"), [(2**63, LATEST_NS), (-1, 0), (0, 0), (LATEST_NS + 1, LATEST_NS)])
def test_an_absurd_stamp_is_clamped(stamp_ns: int, said: int) -> None:
    stamp = read(fox.Log, messages.log("r", "x", False, stamp_ns)).timestamp
    assert stamp.seconds * 10**9 + stamp.nanos == said


def test_pictures_logs_and_events() -> None:
    image = read(fox.CompressedImage, messages.picture("r/eye", b"\xff\xd8", "jpeg", STAMP_NS))
    assert (image.frame_id, image.data, image.format) == ("r/eye", b"\xff\xd8", "jpeg")
    log = read(fox.Log, messages.log("r", "is faulty", True, STAMP_NS))
    assert (log.name, log.message, log.level) == ("r", "is faulty", fox.LogLevel.Warning.value)
    one = Invocation("id", "r", "/r/actions/moveJoints", {}, STAMP_NS, 0, client="me", state=InvocationState.RUNNING)
    event = read(fox.Event, messages.event("r", one, STAMP_NS + 10**9))
    said = {each.key: each.value for each in event.metadata}
    assert said.items() >= {"id": "id", "state": "running", "client": "me", "robot": "r"}.items()
    assert event.end_time.seconds == event.start_time.seconds + 1
    assert read(fox.Event, messages.event("r", one, 0)).end_time == event.start_time, "no event ends before it begins"


def test_an_event_of_the_fleet_tells_the_part_of_one_robot_alone() -> None:
    one = Invocation("id", "", "/actions/stopAll", {}, 1, 2, client="me", robots={"a": "failed: x", "b": "succeeded"})
    said = {each.key: each.value for each in read(fox.Event, messages.event("b", one, 3)).metadata}
    assert said == {"robot": "b", "action": "/actions/stopAll", "state": "succeeded"}


def thing(kind: Kind, geometry: Any) -> SceneObject:
    return SceneObject(title=kind, kind=kind, pose=AT, geometry=geometry)


def test_a_scene_has_an_entity_for_each_object_and_replaces_the_one_before() -> None:
    stl = bytes(84)
    objects = {
        "b": thing("obstacle", Box((1.0, 2.0, 3.0))), "s": thing("zone", Sphere(0.5)),
        "c": thing("obstacle", Cylinder(0.5, 2.0)), "m": thing("obstacle", TriangleMesh(stl)),
    }  # fmt: skip
    update = read(fox.SceneUpdate, messages.scene(objects, STAMP_NS))
    assert [each.type for each in update.deletions] == [fox.SceneEntityDeletionType.All.value]
    found = {each.id: each for each in update.entities}
    assert {each.frame_id for each in found.values()} == {"world"}
    assert found["b"].cubes[0].size.z == 3.0 and found["b"].cubes[0].pose.position.y == 2.0
    assert found["s"].spheres[0].size.x == 1.0
    assert (found["c"].cylinders[0].size.x, found["c"].cylinders[0].size.z) == (1.0, 2.0)
    assert found["m"].models[0].data == stl
    assert {each.key: each.value for each in found["s"].metadata} == {"title": "zone", "kind": "zone"}


def test_what_a_link_holds_moves_with_the_frame_of_the_link() -> None:
    held = replace(thing("obstacle", Sphere(0.5)), held=Held("panda", "panda_hand", AT))
    (found,) = read(fox.SceneUpdate, messages.scene({"s": held}, STAMP_NS)).entities
    assert (found.frame_id, found.frame_locked) == ("panda/panda_hand", True)
    assert found.spheres[0].pose.position.y == 2.0


def test_meshes_for_which_there_is_no_room_are_left_out(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(messages, "MESH_BYTES", 200)
    objects = {
        "a": thing("zone", TriangleMesh(bytes(134))), "b": thing("zone", TriangleMesh(bytes(84))),
        "c": thing("zone", Sphere(1.0)),
    }  # fmt: skip
    update = read(fox.SceneUpdate, messages.scene(objects, STAMP_NS))
    assert [each.id for each in update.entities] == ["a", "c"]
