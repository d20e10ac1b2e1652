"""Which parts of a ROS graph become parts of a robot."""

import pytest

from linked_fleet_agent.robots.ros2.configuration import ActionEntry, Configuration, PropertyEntry, read_configuration
from linked_fleet_agent.robots.ros2.graph import Interface, Offer, Role
from linked_fleet_agent.robots.ros2.selection import select

FIBONACCI, HASH = "test_msgs/action/Fibonacci", "RIHS01_" + "a" * 64


def offer(role: Role, name: str, type_: str = "std_msgs/msg/Bool", latched: bool = False, hash: str = HASH) -> Offer:
    return Offer(role, Interface(name, type_), hash, latched)


ACTION = (
    offer("service", "/cell/fetch/_action/send_goal", f"{FIBONACCI}_SendGoal", hash="RIHS01_1"),
    offer("service", "/cell/fetch/_action/get_result", f"{FIBONACCI}_GetResult", hash="RIHS01_2"),
    offer("service", "/cell/fetch/_action/cancel_goal", "action_msgs/srv/CancelGoal"),
    offer("publisher", "/cell/fetch/_action/feedback", f"{FIBONACCI}_FeedbackMessage", hash="RIHS01_3"),
    offer("publisher", "/cell/fetch/_action/status", "action_msgs/msg/GoalStatusArray", latched=True),
)


def test_an_entry_gets_its_type_from_the_graph() -> None:
    configuration = Configuration(
        properties=(PropertyEntry(topic="/lamp/on", component="lamp", name="on"),),
        actions=(ActionEntry(action="/cell/fetch", component="cell", name="fetch"),),
    )
    lamp, fetch = select(configuration, [offer("publisher", "/lamp/on", latched=True), *ACTION]).selected
    assert (lamp.entry.type, lamp.hashes, lamp.latched) == ("std_msgs/msg/Bool", {"std_msgs/msg/Bool": HASH}, True)
    assert fetch.entry.type == FIBONACCI
    assert fetch.hashes == {
        f"{FIBONACCI}_SendGoal": "RIHS01_1", f"{FIBONACCI}_GetResult": "RIHS01_2",
        f"{FIBONACCI}_FeedbackMessage": "RIHS01_3",
    }  # fmt: skip


def test_an_entry_that_nobody_offers_is_missing_unless_its_type_is_stated() -> None:
    stated = PropertyEntry(topic="/a", component="ros", name="a", type="std_msgs/msg/Bool")
    unknown = ActionEntry(service="/b", component="ros", name="b")
    selected, missing = select(Configuration(properties=(stated,), actions=(unknown,)), [])
    assert [each.entry for each in selected] == [stated] and selected[0].hashes == {}
    assert missing == ("the service /b is not there, and the configuration does not state its type",)


def test_a_topic_that_others_only_read_has_the_type_that_they_read() -> None:
    written = PropertyEntry(topic="/a", component="ros", name="a", write=True)
    (only,) = select(Configuration(properties=(written,)), [offer("subscription", "/a", latched=True)]).selected
    assert only.entry.type == "std_msgs/msg/Bool" and not only.latched


@pytest.mark.parametrize(
    ("offered", "taken"),
    [
        (offer("publisher", "/lamp/on"), ("lamp", "on")),
        (offer("publisher", "/arm/lamp/on"), ("lamp", "on")),
        (offer("publisher", "/on"), ("ros", "on")),
        (offer("publisher", "/a/b/c"), ("a_b", "c")),
        (offer("service", "/lamp/toggle", "std_srvs/srv/Trigger"), ("lamp", "toggle")),
        (ACTION[0], ("cell", "fetch")),
        (ACTION[1], None),
        (ACTION[3], None),
        (ACTION[4], None),
        (offer("subscription", "/lamp/on"), None),
        (offer("client", "/lamp/toggle", "std_srvs/srv/Trigger"), None),
        (offer("publisher", "/rosout", "rcl_interfaces/msg/Log"), None),
        (offer("publisher", "/parameter_events"), None),
        (offer("publisher", "/arm/joint_states", "sensor_msgs/msg/JointState"), None),
        (offer("publisher", "/camera/image", "sensor_msgs/msg/Image"), None),
        (offer("publisher", "/lidar/points", "sensor_msgs/msg/PointCloud2"), None),
        (offer("publisher", "/map", "nav_msgs/msg/OccupancyGrid"), None),
        (offer("service", "/node/set_parameters", "rcl_interfaces/srv/SetParameters"), None),
        (offer("service", "/node/get_type_description", "type_description_interfaces/srv/GetTypeDescription"), None),
        (offer("service", "/to/_action/send_goal", "nav2_msgs/action/NavigateToPose_SendGoal"), None),
        (offer("service", "/arm/x/_action/send_goal", "control_msgs/action/FollowJointTrajectory_SendGoal"), None),
        (offer("service", "/controller_manager/switch", "controller_manager_msgs/srv/SwitchController"), None),
        (offer("publisher", "/secret/key"), None),
    ],
)
def test_patterns_expose_what_matches_but_for_what_is_denied(offered: Offer, taken: tuple[str, str] | None) -> None:
    configuration = read_configuration(None, "/arm", expose=["/*"], deny=["/secret/*"])
    found = select(configuration, [offered], "/arm").selected
    assert [(each.entry.component, each.entry.name) for each in found] == ([taken] if taken else [])


def test_a_pattern_exposes_no_more_than_it_says() -> None:
    configuration = read_configuration(None, expose=["/lamp/*"])
    assert select(configuration, [offer("publisher", "/lamps/on")]).selected == ()
    assert select(Configuration(), [offer("publisher", "/lamp/on")]).selected == ()


def test_what_the_configuration_names_is_not_exposed_twice() -> None:
    entry = PropertyEntry(topic="/lamp/on", component="lamp", name="lit")
    configuration = Configuration(properties=(entry,), expose=("/lamp/*",))
    (only,) = select(configuration, [offer("publisher", "/lamp/on"), offer("publisher", "/lamp/on")]).selected
    assert only.entry.name == "lit"
