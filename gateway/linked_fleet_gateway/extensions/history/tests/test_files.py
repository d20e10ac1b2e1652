"""Files of histories, read by independent readers."""

import csv
import io
import math
from typing import Any

import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory

from floor_maps import FREE, UNKNOWN, WALL, pgm
from linked_fleet_agent.wire.codec import encode_state
from linked_fleet_agent.wire.messages import Base, State
from linked_fleet_gateway.extensions.history.files import recording, table
from linked_fleet_gateway.extensions.history.ground import Ground
from linked_fleet_gateway.extensions.history.track import Excerpt, Joints, all_columns, samples
from linked_fleet_gateway.extensions.world.floor_map import MapSettings
from linked_fleet_gateway.extensions.world.map_image import build_map
from linked_fleet_rdf.graph import NEWTON_METRE, RADIAN
from linked_fleet_state.model import Pose, RobotModel

S = 1_000_000_000
ODD = 'arm 2/"left",é'
URDF = """<robot name='r'><link name='a'/><link name='b'/><link name='c'/>
<joint name='turn' type='continuous'><parent link='a'/><child link='b'/></joint>
<joint name='arm 2/&quot;left&quot;,é' type='prismatic'><parent link='b'/><child link='c'/>
<limit lower='0' upper='1' velocity='1' effort='1'/></joint></robot>"""
BASE = Base((1.0, 2.0, 3.0), (0.0, 0.0, 0.6, 0.8), (0.1, 0.2, 0.3), (0.4, 0.5, 0.6))


def excerpt(*values: tuple[int, float], floating: bool = False) -> Excerpt:
    frames = [
        encode_state(
            State(
                incarnation=1, sequence=1, monotonic_ns=1, wall_ns=stamp, base=BASE if floating else None,
                positions=(value, 0.5), velocities=(-value, math.nan), efforts=(10 * value, 20.0),
            )
        )
        for stamp, value in values
    ]  # fmt: skip
    return Excerpt(Joints(RobotModel.for_urdf(URDF), ("turn", ODD), floating), tuple(frames))


def messages(content: bytes) -> list[tuple[str, int, Any]]:
    reader = make_reader(io.BytesIO(content), decoder_factories=[DecoderFactory()])
    return [(channel.topic, message.log_time, body) for _, channel, message, body in reader.iter_decoded_messages()]


def test_another_reader_finds_joint_states_and_the_model_in_a_recording() -> None:
    said = messages(recording(excerpt((S + 7, 0.25), (3 * S, -1.0)), b"<robot/>"))
    assert [(topic, at) for topic, at, _ in said] == [
        ("/robot_description", S + 7),
        ("/joint_states", S + 7),
        ("/joint_states", 3 * S),
    ]
    (_, _, model), (_, _, first), (_, _, second) = said
    assert model.data == "<robot/>"
    assert (first.header.stamp.sec, first.header.stamp.nanosec) == (1, 7)
    assert list(first.name) == ["turn", ODD]
    assert list(first.position) == [0.25, 0.5] and list(second.position) == [-1.0, 0.5]
    assert list(first.effort) == [2.5, 20.0]
    assert first.velocity[0] == -0.25 and math.isnan(first.velocity[1])


def test_a_recording_of_a_floating_base_says_where_it_is() -> None:
    content = recording(excerpt((S, 0.25), floating=True), b"")
    (transform,) = next(body for topic, _, body in messages(content) if topic == "/tf").transforms
    assert (transform.header.frame_id, transform.child_frame_id) == ("world", "a")
    place, turn = transform.transform.translation, transform.transform.rotation
    assert (place.x, place.y, place.z) == BASE.position_m
    assert (turn.x, turn.y, turn.z, turn.w) == BASE.orientation_xyzw


def ground(placement: Pose, mapped: bool = True) -> Ground:
    settings = MapSettings(
        resolution=0.5, origin=(1.0, -2.0, math.pi / 2), negate=False, occupied_thresh=0.65, free_thresh=0.196
    )
    image = pgm(((WALL, FREE, UNKNOWN), (WALL, FREE, FREE)))
    floor = build_map(settings, image, title="hall", height_m=2.0, client="", now_ns=7 * S + 1) if mapped else None
    return Ground(placement, floor)


TURNED = Pose((10.0, 20.0, 0.0), (0.0, 0.0, math.sqrt(0.5), math.sqrt(0.5)))


def test_a_recording_of_a_drive_has_the_map_and_the_base_in_its_frame() -> None:
    said = messages(recording(excerpt((S, 0.25), (2 * S, 0.5), floating=True), b"<robot/>", ground=ground(TURNED)))
    assert [topic for topic, _, _ in said].count("/map") == 1 and "/tf_static" not in {topic for topic, _, _ in said}
    ((at, grid),) = [(at, body) for topic, at, body in said if topic == "/map"]
    assert (at, grid.header.frame_id, grid.info.map_load_time.sec) == (S, "world", 7)
    assert (grid.info.width, grid.info.height, grid.info.resolution) == (3, 2, 0.5)
    origin = grid.info.origin
    assert (origin.position.x, origin.position.y, origin.position.z) == (1.0, -2.0, 0.0)
    assert (origin.orientation.z, origin.orientation.w) == pytest.approx((math.sqrt(0.5), math.sqrt(0.5)))
    assert list(grid.data) == [100, 0, 0, 100, 0, -1]  # the lowest row first
    moved = [body.transforms[0] for topic, _, body in said if topic == "/tf"]
    assert len(moved) == 2 and moved[0].header.frame_id == "world"
    place = moved[0].transform.translation
    assert (place.x, place.y, place.z) == pytest.approx((10.0 - 2.0, 20.0 + 1.0, 3.0))


def test_a_recording_of_a_robot_that_stands_says_where() -> None:
    said = messages(recording(excerpt((S, 0.25), (2 * S, 0.5)), b"<robot/>", ground=ground(TURNED, mapped=False)))
    assert {topic for topic, _, _ in said} == {"/joint_states", "/robot_description", "/tf_static"}
    (only,) = [body.transforms for topic, _, body in said if topic == "/tf_static"]
    assert (only[0].header.frame_id, only[0].child_frame_id, only[0].transform.translation.y) == ("world", "a", 20.0)


def test_a_recording_of_nothing_can_be_opened() -> None:
    assert messages(recording(excerpt(), b"<robot/>")) == []


def test_a_robot_without_joints_can_be_recorded() -> None:
    frame = encode_state(
        State(incarnation=1, sequence=1, monotonic_ns=1, wall_ns=S, positions=(), velocities=(), efforts=())
    )
    only = Excerpt(Joints(RobotModel.for_urdf("<robot name='r'><link name='a'/></robot>"), (), False), (frame,))
    assert [(topic, at) for topic, at, _ in messages(recording(only, b""))][1] == ("/joint_states", S)


def test_a_frame_with_an_infinity_was_never_a_measurement() -> None:
    assert [stamp for stamp, _ in samples(excerpt((S, 0.25), (2 * S, math.inf), (3 * S, -math.inf)))] == [S]


def test_a_table_has_units_in_its_header_and_empty_cells_for_unknown_values() -> None:
    kept = excerpt((S + 7, 0.25))
    content = table(all_columns("r", kept.joints), samples(kept))
    assert content.endswith(b"\r\n") and content.count(b"\n") == 2
    (row,) = csv.DictReader(io.StringIO(content.decode(), newline=""))
    odd = "arm~202~2F~22left~22~2C~C3~A9"
    assert row == {
        "time": "1970-01-01T00:00:01.000000007Z", "turn/rotation (rad)": "0.25", f"{odd}/translation (m)": "0.5",
        "turn/velocity (rad/s)": "-0.25", f"{odd}/velocity (m/s)": "", "turn/effort (N.m)": "2.5",
        f"{odd}/effort (N)": "20.0",
    }  # fmt: skip


def test_the_columns_of_a_floating_base_come_first() -> None:
    kept = excerpt((S, 0.25), floating=True)
    columns, ((_, numbers),) = all_columns("r", kept.joints), samples(kept)
    assert len(columns) == len(numbers) == 13 + 6
    assert [name for name, _ in columns][:4] == [
        "pose.position.x",
        "pose.position.y",
        "pose.position.z",
        "pose.orientation.x",
    ]
    assert dict(zip([name for name, _ in columns], numbers, strict=True))["twist.angular.z"] == 0.6


def test_values_are_told_with_all_their_digits() -> None:
    value = 0.1 + 0.2
    rows = list(csv.reader(io.StringIO(table([("x", RADIAN), ("y", NEWTON_METRE)], [(S, (value, 1e-300))]).decode())))
    assert [float(each) for each in rows[1][1:]] == [value, 1e-300]
