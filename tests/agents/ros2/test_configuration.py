"""The TOML file of a ROS 2 robot: what it gives, and what is refused with the place and what would be right."""

import re
from pathlib import Path

import pytest

from linked_fleet_agent.robots.ros2.address import AddressError
from linked_fleet_agent.robots.ros2.configuration import (
    ActionEntry,
    ComponentEntry,
    Configuration,
    ConfigurationError,
    EventEntry,
    PropertyEntry,
    read_configuration,
)
from linked_fleet_agent.robots.ros2.exposure import MAX_ACTIONS, MAX_COMPONENTS, MAX_PROPERTIES
from linked_fleet_agent.robots.ros2.members import ACTION_S, MOTION_S, SERVICE_S
from linked_fleet_agent.robots.ros2.units import Meaning
from running import ROOT


@pytest.fixture
def file(tmp_path: Path) -> Path:
    return tmp_path / "arm.toml"


def test_the_usual_entry_is_two_lines(file: Path) -> None:
    file.write_text("""
[[property]]
topic = "temperature"

[[event]]
topic = "/bumper/hit"

[[action]]
service = "/lights/set"

[[action]]
action = "/arm/cell/fetch"
moves = ["base"]
""")
    assert read_configuration(file, "/arm") == Configuration(
        properties=(PropertyEntry(topic="/arm/temperature", component="ros", name="temperature"),),
        events=(EventEntry(topic="/bumper/hit", component="bumper", name="hit"),),
        actions=(
            ActionEntry(service="/lights/set", component="lights", name="set"),
            ActionEntry(action="/arm/cell/fetch", component="cell", name="fetch", moves=("base",)),
        ),
    )


def test_everything_can_be_said(file: Path) -> None:
    file.write_text("""
expose = ["/gpio/*"]
deny = ["secret/*"]

[[property]]
topic = "/a/b/speed"
type = "std_msgs/msg/Float64"
component = "belt"
name = "velocity"
title = "Speed of the belt"
description = "As the encoder says."
term = "https://example.org/speed"
unit = "M-PER-SEC"
write = true
latched = false
stale_s = 60

[component.belt]
title = "Belt"
kind = "https://example.org/Belt"
link = "tool0"
rate_hz = 2
stale_s = 30

[units]
"my_msgs/msg/Oven.heat" = "K"
"my_msgs/msg/Oven.power" = { unit = "W", term = "https://example.org/power" }
""")
    said = read_configuration(file, "/arm", expose=["more/*"], deny=["*/raw"])
    assert said.expose == ("/gpio/*", "/arm/more/*") and said.deny == ("/arm/secret/*", "*/raw")
    assert said.properties[0].component == "belt" and said.properties[0].stale_s == 60.0
    assert said.components["belt"] == ComponentEntry(
        title="Belt", kind="https://example.org/Belt", link="tool0", rate_hz=2, stale_s=30
    )
    assert said.meanings == {
        "my_msgs/msg/Oven.heat": Meaning("K"),
        "my_msgs/msg/Oven.power": Meaning("W", "https://example.org/power"),
    }


def test_without_a_file_there_are_patterns_alone() -> None:
    assert not read_configuration(None)
    assert read_configuration(None, expose=["/lamp/*"]).expose == ("/lamp/*",)
    with pytest.raises(ConfigurationError, match="expose and deny: 'lamp topics' is not a pattern of names"):
        read_configuration(None, expose=["lamp topics"])
    with pytest.raises(ConfigurationError, match="64 patterns are the maximum"):
        read_configuration(None, expose=["/a"] * 65)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("a = [", "is not TOML: Invalid value"),
        ("\x00", "is not TOML"),
        (
            "[[property]]\ntopic = '/t'\nfild = 3",
            "[[property]] number 1: object contains unknown field `fild`; its keys are",
        ),
        ("[[property]]\ntopic = '/t'\n[[property]]", "[[property]] number 2: object missing required field `topic`"),
        ("[[property]]\ntopic = 3", "[[property]] number 1, topic: expected `str`, got `int`"),
        ("[[property]]\ntopic = '/t'\nstale_s = nan", "[[property]] number 1, stale_s: expected `float`"),
        ("[[property]]\ntopic = '/t'\nunit = 'm/s'", "[[property]] number 1, unit: expected `str` matching"),
        ("[[property]]\ntopic = '/a b'", "[[property]] number 1: '/a b' is not a name of ROS such as /lamp/level"),
        ("[[property]]\ntopic = '/1a'", "'/1a' is not a name of ROS"),
        ("[[property]]\ntopic = '/t'\nname = 'a b'", "'a b' is no name; letters, digits and _ make one"),
        ("[[property]]\ntopic = '/t'\ntype = 'Float64'", "'Float64' is not the name of a type"),
        ("[[property]]\ntopic = '/t'\ntype = 'std_srvs/srv/Trigger'", "that of a topic is PACKAGE/msg/NAME"),
        (
            "[[property]]\ntopic = '/t'\n[[event]]\ntopic = '/t'",
            "ros has two members 't'; give one of them another 'name'",
        ),
        ("[[action]]\nservice = '/t'\naction = '/t'", "[[action]] number 1 names service and action; one of topic,"),
        ("[[action]]\n", "[[action]] number 1 names nothing"),
        ("[[action]]\nservice = '/t'\nstop_s = 100", "[[action]] number 1, stop_s: expected `float` <= 30.0"),
        ("[[action]]\nservice = '/t'\nmoves = [1]", "[[action]] number 1, moves[0]: expected `str`"),
        ("[component.x]\nrate_hz = 0", "[component.NAME], rate_hz: expected `float` > 0.0"),
        ("[component.'a b']", "[component.NAME]: 'a b' is no name"),
        ("[[components]]", "unknown field `components`; the tables and keys are property, event, action, component,"),
        ("property = 3", "[[property]]: expected `array`, got `int`"),
        ("expose = ['a b']", "'a b' is not a pattern of names such as /lamp/*"),
        ("[units]\n'a.b' = 3", "in units; the tables and keys are"),
        ("x = " + "[" * 5000, "is not TOML"),
        ("#" * 1_100_000, "has more than 1048576 bytes"),
        ("[[event]]\ntopic = '/t'\n" * 257, "[[event]]: expected `array` of length <= 256"),
    ],
)
def test_what_cannot_be_used_is_refused_with_its_place(file: Path, text: str, said: str) -> None:
    file.write_text(text)
    with pytest.raises(ConfigurationError) as refused:
        read_configuration(file)
    assert str(refused.value).startswith(str(file)) and said in str(refused.value)
    assert isinstance(refused.value, AddressError)


def test_a_file_that_is_not_there_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigurationError, match="cannot be read: No such file"):
        read_configuration(tmp_path / "none.toml")


PAGE = (ROOT / "docs" / "ROS2.md").read_text()


def test_the_example_of_the_page_is_read_and_its_table_has_all_keys(file: Path) -> None:
    (example,) = re.findall(r"```toml\n(.*?)```", PAGE, re.S)
    file.write_text(example)
    said = read_configuration(file)
    assert [each.ros_name for each in said.entries] == [
        "/oven/temperature", "/lamp/level", "/door/opened", "/lamp/switch", "/conveyor/advance",
    ]  # fmt: skip
    keys = PAGE.partition("### Keys")[2].partition("### Types")[0]
    structs = (PropertyEntry, EventEntry, ActionEntry, ComponentEntry)
    assert [name for each in structs for name in each.__struct_fields__ if f"`{name}`" not in keys] == []


def test_the_page_has_the_defaults_of_the_code() -> None:
    keys = PAGE.partition("### Keys")[2].partition("### Types")[0]
    component, action = ComponentEntry(), ActionEntry()
    assert f"`rate_hz` ({component.rate_hz:g}), `stale_s` ({component.stale_s:g})" in keys
    assert f"a service {SERVICE_S:g}, an action {ACTION_S:,.0f}, one that moves {MOTION_S:,.0f}" in keys
    assert f"`stop_s` ({action.stop_s:g})" in keys and f"`rate_hz` ({EventEntry(topic='/a').rate_hz:g})" in keys
    bounds = PAGE.partition("### Types")[2]
    assert f"{MAX_COMPONENTS} components, {MAX_PROPERTIES} properties, {MAX_ACTIONS} actions" in bounds
