"""The JSON form of messages and its schema."""

import math
from collections.abc import Mapping
from pathlib import Path
from random import Random
from typing import Any

import msgspec
import pytest

from agents.ros2.test_serialization import random_message
from linked_fleet_agent.robots.ros2.definitions import Definition, DefinitionError
from linked_fleet_agent.robots.ros2.distributions import DISTRIBUTIONS, distribution
from linked_fleet_agent.robots.ros2.serialization import CdrError
from linked_fleet_agent.robots.ros2.types import MessageTypes
from linked_fleet_agent.robots.ros2.units import MEANINGS, Meaning
from linked_fleet_agent.robots.ros2.views import View
from linked_fleet_agent.wire.schema import Schema, schema_problem, value_problem

TYPES = MessageTypes()
NAMES = [each for each in distribution("jazzy") if each.split("/")[1] == "msg"]


def at(schema: Schema, path: str) -> Schema:
    for name in path.split("."):
        schema = schema.items if name == "[]" else schema.properties[name]  # type: ignore[assignment]
    return schema


def contains(all_: Any, some: Any) -> bool:
    """Return whether a message that was written again has all that was known before."""
    if isinstance(some, dict):
        return all(name in all_ and contains(all_[name], each) for name, each in some.items())
    if isinstance(some, list):
        return len(all_) == len(some) and all(map(contains, all_, some))
    return bool(math.isclose(all_, some, abs_tol=1e-6) if isinstance(some, float) else all_ == some)


@pytest.mark.parametrize("name", NAMES)
def test_every_message_conforms_to_the_schema_of_its_type(name: str) -> None:
    type_, random = TYPES.message(name), Random(name)
    try:
        view = View(type_)
    except DefinitionError as error:
        assert "nested more than 4 deep" in str(error)
        return
    assert schema_problem(view.schema) == ""
    for _ in range(5):
        said = view.value(type_.read(type_.write(random_message(random, type_))))
        if said is not None:
            assert value_problem(view.schema, said) == ""
            assert contains(view.value(type_.read(type_.write(view.message(said)))), said)
            assert b"null" not in msgspec.json.encode(said)


@pytest.mark.parametrize(
    ("type_", "path", "unit"),
    [
        ("sensor_msgs/msg/Temperature", "temperature", "DEG_C"),
        ("sensor_msgs/msg/BatteryState", "voltage", "V"),
        ("sensor_msgs/msg/BatteryState", "cell_voltage.[]", "V"),
        ("sensor_msgs/msg/BatteryState", "header.stamp", "SEC"),
        ("geometry_msgs/msg/TwistStamped", "twist.linear.x", "M-PER-SEC"),
        ("geometry_msgs/msg/TwistStamped", "twist.angular.z", "RAD-PER-SEC"),
        ("geometry_msgs/msg/WrenchStamped", "wrench.force.x", "N"),
        ("geometry_msgs/msg/WrenchStamped", "wrench.torque.x", "N-M"),
        ("geometry_msgs/msg/PoseStamped", "pose.position.z", "M"),
        ("geometry_msgs/msg/PoseStamped", "pose.orientation.w", ""),
        ("nav_msgs/msg/Odometry", "pose.pose.position_x", "M"),
        ("nav_msgs/msg/Odometry", "twist.twist.angular_z", "RAD-PER-SEC"),
        ("sensor_msgs/msg/Imu", "linear_acceleration.x", "M-PER-SEC2"),
        ("sensor_msgs/msg/JointState", "position.[]", ""),
    ],
)
def test_numbers_have_the_units_of_ros(type_: str, path: str, unit: str) -> None:
    assert at(View(TYPES.message(type_)).schema, path).unit == unit


@pytest.mark.parametrize("key", MEANINGS)
def test_every_key_of_the_table_is_a_field_in_some_distribution(key: str) -> None:
    type_, _, path = key.partition(".")
    assert any(is_there(distribution(name), type_, path) for name in DISTRIBUTIONS)


def is_there(definitions: Mapping[str, Definition], type_: str, path: str) -> bool:
    for name in path.split(".") if path else []:
        fields = {field.name: field.type for field in definitions[type_].fields} if type_ in definitions else {}
        if name not in fields:
            return False
        type_ = fields[name]
    return bool(path) or type_ in definitions


def test_configured_meanings_come_first() -> None:
    meanings = {
        "sensor_msgs/msg/Temperature.temperature": Meaning("K", "https://example.org/temperature"),
        "sensor_msgs/msg/Temperature": Meaning("UNITLESS"),
    }
    schema = View(TYPES.message("sensor_msgs/msg/Temperature"), meanings).schema
    assert at(schema, "temperature").unit == "K"
    assert at(schema, "temperature").semantic_type == "https://example.org/temperature"
    assert at(schema, "variance").unit == "UNITLESS"


def test_a_message_of_one_member_is_that_member() -> None:
    view = View(TYPES.message("std_msgs/msg/Float64"))
    assert view.schema.type == "number" and view.value({"data": 1.5}) == 1.5 and view.message(1.5) == {"data": 1.5}
    as_object = View(TYPES.message("std_msgs/msg/Float64"), is_object=True)
    assert as_object.value({"data": 1.5}) == {"data": 1.5}


def test_a_field_stands_for_its_message() -> None:
    odometry = TYPES.message("nav_msgs/msg/Odometry")
    view = View(odometry, field="twist.twist.linear")
    assert at(view.schema, "x").unit == "M-PER-SEC"
    message = view.message({"x": 0.5})
    assert message == {"twist": {"twist": {"linear": {"x": 0.5}}}}
    assert view.value(odometry.read(odometry.write(message))) == {"x": 0.5, "y": 0.0, "z": 0.0}


@pytest.mark.parametrize(
    ("field", "said"),
    [
        ("twist.speed", "geometry_msgs/msg/TwistWithCovariance has no field 'speed'; its fields are twist, covariance"),
        ("header.stamp.sec.x", "int32 has no field 'x'; its fields are none"),
        ("pose.covariance.x", "float64 has no field 'x'; its fields are none"),
        (".", "nav_msgs/msg/Odometry has no field ''"),
    ],
)
def test_a_field_that_is_not_there_is_refused_with_those_that_are(field: str, said: str) -> None:
    with pytest.raises(DefinitionError) as refused:
        View(TYPES.message("nav_msgs/msg/Odometry"), field=field)
    assert said in str(refused.value)


@pytest.mark.parametrize("number", [math.nan, math.inf, -math.inf, 1e301])
def test_a_number_that_json_does_not_carry_is_unknown(number: float) -> None:
    assert View(TYPES.message("std_msgs/msg/Float64")).value({"data": number}) is None
    assert View(TYPES.message("std_msgs/msg/Float64MultiArray"), field="data").value({"data": [1.0, number]}) is None
    imu = TYPES.message("sensor_msgs/msg/Imu")
    said = View(imu).value(imu.read(imu.write({"angular_velocity": {"x": 1.0, "y": number}})))
    assert said["angular_velocity"] == {"x": 1.0, "z": 0.0}


@pytest.mark.parametrize(("number", "said"), [(2**53, 2**53), (2**53 + 1, None), (-(2**60), None)])
def test_an_integer_that_json_does_not_carry_is_unknown(number: int, said: int | None) -> None:
    assert View(TYPES.message("std_msgs/msg/Int64")).value({"data": number}) == said


def test_a_long_array_is_unknown() -> None:
    view = View(TYPES.message("sensor_msgs/msg/LaserScan"))
    scan: dict[str, Any] = {"ranges": [1.0] * 4097, "intensities": [1.0] * 4096, "range_max": 5.0}
    type_ = TYPES.message("sensor_msgs/msg/LaserScan")
    said = view.value(type_.read(type_.write(scan)))
    assert "ranges" not in said and len(said["intensities"]) == 4096 and said["range_max"] == 5.0


@pytest.mark.parametrize(
    ("seconds", "said"),
    [
        (0.0, {"sec": 0, "nanosec": 0}),
        (1.25, {"sec": 1, "nanosec": 250_000_000}),
        (-0.25, {"sec": -1, "nanosec": 750_000_000}),
        (0.9999999999, {"sec": 1, "nanosec": 0}),
    ],
)
def test_durations_are_seconds(seconds: float, said: dict[str, int]) -> None:
    view = View(TYPES.message("nav2_msgs/action/NavigateToPose_Feedback"), field="navigation_time")
    assert view.schema == Schema(type="number", unit="SEC")
    assert view.message(seconds) == {"navigation_time": said}
    assert view.value({"navigation_time": said}) == pytest.approx(seconds)


def test_bytes_are_base64_and_a_uuid_its_text() -> None:
    view = View(TYPES.message("sensor_msgs/msg/CompressedImage"), field="data")
    assert view.value({"data": b"\x00\xff"}) == "AP8=" and view.message("AP8=") == {"data": b"\x00\xff"}
    with pytest.raises(CdrError, match="'AP8' is not base64"):
        view.message("AP8")
    goal = View(TYPES.message("action_msgs/msg/GoalInfo"), field="goal_id")
    text = "00010203-0405-0607-0809-0a0b0c0d0e0f"
    assert goal.value({"goal_id": {"uuid": bytes(range(16))}}) == text
    assert goal.message(text) == {"goal_id": {"uuid": bytes(range(16))}}
    with pytest.raises(CdrError, match="is not a UUID"):
        goal.message("x" * 36)


def test_what_is_too_deep_comes_up_with_a_joined_name_or_is_named() -> None:
    goal = View(TYPES.message("nav2_msgs/action/NavigateToPose_Goal"), is_object=True)
    assert goal.left_out == []
    message = goal.message({"pose": {"pose": {"position_x": 1.0}}})
    assert message == {"pose": {"pose": {"position": {"x": 1.0}}}}
    trajectory = View(TYPES.message("trajectory_msgs/msg/JointTrajectory"))
    assert "points.positions: it is nested more than 4 deep" in trajectory.left_out


def test_what_an_input_must_have() -> None:
    type_ = TYPES.message("nav2_msgs/action/DockRobot_Goal")
    moving = View(type_, need="all", is_object=True).schema
    assert moving.required == ("dock_id", "dock_pose", "dock_type"), "the others have defaults of their own"
    assert at(moving, "max_staging_time").default == 1000.0 and at(moving, "dock_pose.header").required == ("frame_id",)
    still = View(type_, need="none", is_object=True).schema
    assert still.required == () and at(still, "use_dock_id").default is True


def test_constants_explain_their_field() -> None:
    battery = View(TYPES.message("sensor_msgs/msg/BatteryState")).schema
    assert at(battery, "power_supply_status").description.startswith("0: UNKNOWN, 1: CHARGING, 2: DISCHARGING")
    safety = View(TYPES.message("ur_dashboard_msgs/msg/SafetyMode"), is_object=True).schema
    assert at(safety, "mode").description.startswith("1: NORMAL, 2: REDUCED, 3: PROTECTIVE_STOP")
    assert at(battery, "voltage").description == ""


def test_an_object_has_a_bounded_number_of_members() -> None:
    fields = [
        {"name": f"a{n}", "default_value": "",
         "type": {"type_id": 2, "capacity": 0, "string_capacity": 0, "nested_type_name": ""}}
        for n in range(70)
    ]  # fmt: skip
    wide = {"type_description": {"type_name": "x/msg/Y", "fields": fields}, "referenced_type_descriptions": []}
    view = View(MessageTypes().describe(wide))
    assert len(view.schema.properties) == 64 and len(view.left_out) == 6
    assert view.left_out[0] == "a64: an object has at most 64 members, each with a name of its own"


def test_a_message_of_another_distribution_lacks_what_it_does_not_have() -> None:
    """Controllers of Humble do not say their update rate, and without a hash nobody knows that they are of Humble."""
    name = "controller_manager_msgs/msg/ControllerState"
    payload = MessageTypes(preferred="humble").message(name).write({"name": "arm", "state": "active"})
    said = View(TYPES.message(name)).value(TYPES.message(name).read(payload))
    assert said["name"] == "arm" and "update_rate" not in said


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("wstring a", "a is a wstring, which implementations of ROS write differently"),
        ("Y inner", "contains itself"),
        ("Y[] inner", "contains itself"),
        ("Z inner", "the type x/msg/Z is not defined"),
    ],
)
def test_a_type_whose_messages_cannot_be_read_has_no_json_form(tmp_path: Path, text: str, said: str) -> None:
    file = tmp_path / "x" / "msg" / "Y.msg"
    file.parent.mkdir(parents=True)
    file.write_text(text)
    with pytest.raises(DefinitionError) as refused:
        View(MessageTypes([tmp_path]).message("x/msg/Y"))
    assert said in str(refused.value)


def test_arrays_have_their_bounds_terms_and_the_units_of_their_items(tmp_path: Path) -> None:
    file = tmp_path / "x" / "msg" / "Y.msg"
    file.parent.mkdir(parents=True)
    file.write_text("float32[5000] wide\nfloat32[4096] just\nstring<=3[<=2] words\nfloat32[] heats\nstring name\n")
    meanings = {"x/msg/Y.heats": Meaning("K", "https://example.org/heats"), "x/msg/Y.name": Meaning("K", "urn:x:name")}
    view = View(MessageTypes([tmp_path]).message("x/msg/Y"), meanings)
    assert view.left_out == ["wide: it has 5000 items; 4096 is the maximum"]
    assert schema_problem(view.schema) == ""
    assert at(view.schema, "just") == Schema(type="array", items=Schema(type="number"), min_items=4096, max_items=4096)
    words = at(view.schema, "words")
    assert (words.max_items, words.min_items, at(words, "[]").max_length) == (2, None, 3)
    heats = at(view.schema, "heats")
    assert (heats.semantic_type, at(heats, "[]").unit, at(heats, "[]").semantic_type) == (
        "https://example.org/heats", "K", "",
    )  # fmt: skip
    assert (at(view.schema, "name").unit, at(view.schema, "name").semantic_type) == ("", "urn:x:name")


def test_a_field_has_all_levels_below_it() -> None:
    """The path to a field costs no depth."""
    odometry = View(TYPES.message("nav_msgs/msg/Odometry"), field="pose.pose")
    assert at(odometry.schema, "position.x").unit == "M"
