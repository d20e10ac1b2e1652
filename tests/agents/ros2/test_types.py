"""Types of ROS 2: where they come from, their hashes, and which one is meant.

``type_hashes.json`` has the hashes that ROS itself states: those in its packages of
interfaces for Jazzy and Kilted.
"""

import json
from pathlib import Path
from typing import Any

import pytest

from linked_fleet_agent.robots.ros2.definitions import DefinitionError, Field, read_text
from linked_fleet_agent.robots.ros2.serialization import CdrError
from linked_fleet_agent.robots.ros2.types import GET_TYPE_DESCRIPTION, MessageTypes

HASHES: dict[str, str] = json.loads(Path(__file__).with_name("type_hashes.json").read_text())
FIBONACCI = "test_msgs/action/Fibonacci"
NAVIGATE = "nav2_msgs/action/NavigateToPose"
# As nodes of these types state them; the fields are those of test_msgs.
FILES = {
    "action/Fibonacci.action": "int32 order  # how many\n---\nint32[] sequence\n---\n\nint32[] sequence\n",
    "msg/WStrings.msg": """
        wstring wstring_value
        wstring wstring_value_default1 "Hello world!"
        wstring wstring_value_default2 "Hell\u00f6 w\u00f6rld!"
        wstring wstring_value_default3 "\u30cf\u30ed\u30fc\u30ef\u30fc\u30eb\u30c9"
        #wstring WSTRING_CONST="Hello world!"
        wstring[3] array_of_wstrings
        wstring[<=3] bounded_sequence_of_wstrings
        wstring[] unbounded_sequence_of_wstrings""",
    "msg/Strings.msg": r"""
        string string_value
        string string_value_default1 "Hello world!"
        string string_value_default2 "Hello'world!"
        string string_value_default3 'Hello"world!'
        string string_value_default4 'Hello\'world!'
        string string_value_default5 "Hello\"world!"
        string STRING_CONST="Hello # world!"
        string<=22 bounded_string_value
        string<=22 bounded_string_value_default1 "Hello world!"
        string<=22 bounded_string_value_default2 "Hello'world!"
        string<=22 bounded_string_value_default3 'Hello"world!'
        string<=22 bounded_string_value_default4 'Hello\'world!'
        string<=22 bounded_string_value_default5 "Hello\"world!" """,
}


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for name, text in FILES.items():
        file = tmp_path / "share" / "test_msgs" / name
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text, encoding="utf-8")
    return tmp_path


@pytest.mark.parametrize("name", [each for each in HASHES if not each.startswith("test_msgs/")])
def test_a_type_has_the_hash_that_ros_states(name: str) -> None:
    assert MessageTypes().message(name, HASHES[name]).hash == HASHES[name]


@pytest.mark.parametrize("name", ["action/Fibonacci", "msg/WStrings", "msg/Strings"])
def test_a_type_of_a_folder_has_the_hash_that_ros_states(folder: Path, name: str) -> None:
    assert MessageTypes([folder]).message(f"test_msgs/{name}").hash == HASHES[f"test_msgs/{name}"]


def test_a_folder_of_packages_is_as_good_as_a_prefix(folder: Path) -> None:
    assert MessageTypes([folder / "share"]).action(FIBONACCI).hash == HASHES[FIBONACCI]


def test_parts_of_an_action_are_types(folder: Path) -> None:
    action = MessageTypes([folder]).action(FIBONACCI)
    request = action.send_goal.request.write({"goal_id": {"uuid": bytes(range(16))}, "goal": {"order": 5}})
    assert request == b"\0\1\0\0" + bytes(range(16)) + b"\5\0\0\0"
    assert action.send_goal.name == f"{FIBONACCI}_SendGoal"
    assert action.feedback.read(action.feedback.write({"sequence": [1, 2]})) == {"sequence": [1, 2]}


def test_defaults_and_constants_of_files_are_kept(folder: Path) -> None:
    strings = MessageTypes([folder]).message("test_msgs/msg/Strings")
    said = strings.read(strings.write({"string_value": "x"}))
    assert said["string_value"] == "x" and said["string_value_default4"] == "Hello'world!"
    assert strings.constants == {"STRING_CONST": "Hello # world!"}


def test_a_type_of_a_folder_comes_before_that_of_a_distribution(tmp_path: Path) -> None:
    own = tmp_path / "std_srvs" / "srv" / "Trigger.srv"
    own.parent.mkdir(parents=True)
    own.write_text("string why\n---\nbool success\n")
    types = MessageTypes([tmp_path])
    assert types.service("std_srvs/srv/Trigger").request.fields == (Field("why", "string"),)
    assert types.service("std_srvs/srv/Trigger").hash != MessageTypes().service("std_srvs/srv/Trigger").hash


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("int32", "line 1: 'int32' is neither 'TYPE NAME' nor"),
        ("\n\nint32 a b c", "line 3: 'b c' is no value of a, which is a int32"),
        ("int32 a\nint32 a", "two fields of one name"),
        ("bool a 2", "'2' is no value of a"),
        ("float64[0] a", "a has 0 items; 1 to 65536 can be used"),
        ("float64[99999] a", "a has 99999 items"),
        ("Point p 1", "a default; a x/msg/Point can have none"),
        ("int32 a\n---\nint32 b", "it has 2 parts; a .msg has 1"),
        ("\n".join(f"int8 a{n}" for n in range(513)), "has 513 fields; 512 is the maximum"),
        ("#" * 300_000, "300000 characters; 262144 is the maximum"),
        ("Pkg/sub/Name p", "'Pkg/sub/Name' is not the name of a type"),
    ],
)
def test_a_bad_file_is_refused_with_its_line(text: str, said: str) -> None:
    with pytest.raises(DefinitionError) as refused:
        read_text(text, "x/msg/Y")
    assert said in str(refused.value)


def test_a_bad_file_costs_its_own_types_alone(folder: Path) -> None:
    (folder / "share" / "test_msgs" / "msg" / "Bad.msg").write_text("int32")
    types = MessageTypes([folder])
    with pytest.raises(DefinitionError, match=r"Bad\.msg: test_msgs/msg/Bad, line 1"):
        types.message("test_msgs/msg/Bad")
    assert types.action(FIBONACCI).hash == HASHES[FIBONACCI]


@pytest.mark.parametrize(
    "name", ["std_msgs/String", "std_msgs/msg/", "/msg/X", "a/msg/B\n", "a/idl/B", "a" * 300 + "/msg/B", ""]
)
def test_what_is_no_name_is_refused(name: str) -> None:
    with pytest.raises(DefinitionError, match="is not the name of a type"):
        MessageTypes().message(name)


def test_an_unknown_type_and_an_unknown_hash_are_told_apart() -> None:
    with pytest.raises(DefinitionError, match="the type my_msgs/msg/Lamp is not known"):
        MessageTypes().message("my_msgs/msg/Lamp")
    with pytest.raises(DefinitionError, match=r"is known, but not as the other side has it \(RIHS01_0"):
        MessageTypes().message("std_msgs/msg/String", "RIHS01_" + "0" * 64)


def test_the_hash_decides_which_distribution_is_meant() -> None:
    """Feedback of Nav2 has two more numbers since Lyrical, and controllers of Iron do not say their update rate."""
    for name, distribution in ((NAVIGATE, "lyrical"), ("controller_manager_msgs/msg/ControllerState", "iron")):
        meant = MessageTypes(preferred=distribution).message(name)
        assert meant.hash and meant.hash != MessageTypes().message(name).hash
        assert MessageTypes().message(name, meant.hash).origin is not None
        assert MessageTypes().message(name, meant.hash).hash == meant.hash


def test_the_hashes_of_its_parts_decide_which_action_is_meant() -> None:
    lyrical = MessageTypes(preferred="lyrical").action(NAVIGATE)
    assert lyrical.send_goal.hash == MessageTypes().action(NAVIGATE).send_goal.hash
    stated = {
        lyrical.feedback_message.name: lyrical.feedback_message.hash,
        lyrical.send_goal.name: lyrical.send_goal.hash,
    }
    assert MessageTypes().action(NAVIGATE, stated).hash == lyrical.hash
    with pytest.raises(DefinitionError):
        MessageTypes().action(NAVIGATE, {**stated, lyrical.get_result.name: "RIHS01_"})


def test_without_a_hash_a_message_is_read_as_the_type_that_it_fits() -> None:
    controllers = MessageTypes(preferred="humble").service("controller_manager_msgs/srv/ListControllers")
    assert controllers.hash == "", "Humble has no hashes"
    state = {"name": "arm", "state": "inactive", "type": "x/Y", "claimed_interfaces": ["a/position"]}
    payload = controllers.response.write({"controller": [state]})
    said = MessageTypes().service("controller_manager_msgs/srv/ListControllers").response.read(payload)
    assert said["controller"][0]["claimed_interfaces"] == ["a/position"]
    assert "update_rate" not in said["controller"][0]
    with pytest.raises(CdrError):
        MessageTypes().service(controllers.name, MessageTypes().service(controllers.name).hash).response.read(payload)


def test_an_unknown_distribution_is_refused() -> None:
    with pytest.raises(
        DefinitionError, match=r"'noetic' is no distribution .*; jazzy, kilted, lyrical, humble, iron are"
    ):
        MessageTypes(preferred="noetic")


def described(name: str, *fields: dict[str, Any], **others: list[dict[str, Any]]) -> dict[str, Any]:
    """Return a TypeDescription as ``GetTypeDescription`` returns it."""
    referenced = [{"type_name": f"my_msgs/msg/{other}", "fields": said} for other, said in others.items()]
    return {
        "type_description": {"type_name": name, "fields": list(fields)},
        "referenced_type_descriptions": referenced,
    }


def field(
    name: str, type_id: int, nested: str = "", capacity: int = 0, text: int = 0, default: str = ""
) -> dict[str, Any]:
    type_ = {"type_id": type_id, "capacity": capacity, "string_capacity": text, "nested_type_name": nested}
    return {"name": name, "type": type_, "default_value": default}


LAMP = described(
    "my_msgs/msg/Lamp",
    field("on", 15, default="True"),
    field("colours", 97, "my_msgs/msg/Colour", 3),
    field("name", 21, text=4),
    Colour=[field("red", 10), field("raw", 51, capacity=2)],
)


def test_a_type_that_a_node_describes_is_known_from_then_on() -> None:
    types = MessageTypes()
    lamp = types.describe(LAMP)
    again = types.message("my_msgs/msg/Lamp", lamp.hash)
    payload = again.write({"colours": [{"red": 0.5, "raw": b"ab"}], "name": "desk"})
    assert again.read(payload) == {"on": True, "colours": [{"red": 0.5, "raw": b"ab"}], "name": "desk"}
    assert types.message("my_msgs/msg/Lamp").hash == lamp.hash


def test_a_description_goes_through_its_own_service_unchanged() -> None:
    response = MessageTypes().service(GET_TYPE_DESCRIPTION).response
    said = response.read(response.write({"successful": True, "type_description": LAMP}))
    assert said["type_description"] == LAMP


@pytest.mark.parametrize(
    ("description", "said"),
    [
        (described("my_msgs/msg/A", field("a", 1, "my_msgs/msg/B")), "my_msgs/msg/B is not defined"),
        (described("my_msgs/msg/A", field("a", 1, "my_msgs/msg/A")), "contains itself"),
        (described("my_msgs/msg/A", field("a", 0)), "has the type 0, which cannot be used"),
        (described("my_msgs/msg/A", field("a", 12)), "has the type 12"),
        (described("my_msgs/msg/A", field("a", 200)), "has the type 200"),
        (described("my_msgs/msg/A", field("a", 18)), "a is a wstring, which implementations of ROS write differently"),
        (described("my_msgs/msg/A", field("__class__", 2)), "letters, digits and _ make a name"),
        (described("my_msgs/msg/A", field("a b", 2)), "letters, digits and _ make a name"),
        (described("os; import", field("a", 2)), "is not the name of a type"),
        (described("my_msgs/msg/A", field("a", 50)), "has 0 items"),
        (described("my_msgs/msg/A", field("a", 6, default="x" * 5000)), "a default of more than 4096"),
        (described("my_msgs/msg/A", field("a", 6, default="__import__('os')")), "is no value of a"),
        (described("my_msgs/msg/A", field("a", 3, default="256")), "the default of a is none of its values: 256 is no"),
        (described("my_msgs/msg/A", field("a", 50, capacity=3, default="[1]")), "1 items, where 3 are expected"),
        (
            described("my_msgs/msg/A", field("a", 49, "my_msgs/msg/B", 65_536), B=[field("b", 51, capacity=65_536)]),
            "at least 4294967296 bytes",
        ),
        (
            described(
                "my_msgs/msg/A0",
                field("a", 1, "my_msgs/msg/A1"),
                **{f"A{n}": [field("a", 1, f"my_msgs/msg/A{n + 1}")] for n in range(1, 40)},
                A40=[field("a", 2)],
            ),
            "nested more than 32 deep",
        ),
        (described("my_msgs/msg/A", **{f"B{n}": [field("b", 2)] for n in range(600)}), "refers to 601 types"),
    ],
)
def test_a_hostile_description_is_refused(description: dict[str, Any], said: str) -> None:
    with pytest.raises(DefinitionError) as refused:
        MessageTypes().describe(description)
    assert said in str(refused.value)


def test_descriptions_cost_a_bounded_amount_of_memory() -> None:
    types = MessageTypes()
    for number in range(256):
        types.describe(described(f"my_msgs/msg/A{number}", field("a", 2)))
    with pytest.raises(DefinitionError, match="256 types are described already"):
        types.describe(described("my_msgs/msg/One", field("a", 2)))
    types.describe(described("my_msgs/msg/A0", field("a", 2)))
