"""The address of a ROS 2 robot, parsed from a setting."""

from pathlib import Path

import pytest

from linked_fleet_agent.robots.ros2.address import Address, AddressError, Controller, parse_address

AT = "ros2:tcp/192.0.2.1:7447"


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        ("", Address("tcp/192.0.2.1:7447")),
        ("?tolerance=0.01", Address("tcp/192.0.2.1:7447", tolerance=0.01)),
        ("#iface=eth0", Address("tcp/192.0.2.1:7447#iface=eth0")),
        (
            "?domain=42&namespace=/left/arm&stale=1.5",
            Address(
                "tcp/192.0.2.1:7447",
                42,
                namespace="/left/arm",
                states="/left/arm/joint_states",
                description="/left/arm/robot_description",
                stale_s=1.5,
            ),
        ),
        (
            "?namespace=/a&states=/joint_states&commands=c/joint_trajectory:j%201;k&commands=/d/t:l",
            Address(
                "tcp/192.0.2.1:7447",
                namespace="/a",
                states="/joint_states",
                description="/a/robot_description",
                controllers=(Controller("/a/c/joint_trajectory", ("j 1", "k")), Controller("/d/t", ("l",))),
            ),
        ),
    ],
)
def test_valid_addresses_are_parsed(options: str, expected: Address) -> None:
    assert parse_address(AT + options) == expected


def test_an_address_may_name_a_bridge_of_dds() -> None:
    address = parse_address("ros2dds:tcp/192.0.2.1:7447?namespace=/arm")
    assert address.bridge_only and address.states == "/arm/joint_states"
    with pytest.raises(AddressError, match="the bridge of a ros2dds: address has its own ROS_DOMAIN_ID"):
        parse_address("ros2dds:tcp/192.0.2.1:7447?domain=1")


def test_the_folders_of_meshes_are_those_of_this_machine(tmp_path: Path) -> None:
    assert parse_address(f"{AT}?meshes={tmp_path}&meshes=/").meshes == (tmp_path, Path("/"))


@pytest.mark.parametrize(
    ("text", "named"),
    [
        ("ros2:", "ros2:ENDPOINT"),
        ("ros2:192.0.2.1:7447", "ros2:ENDPOINT"),
        ("ros2:file/x", "ros2:ENDPOINT"),
        ("ros2:tcp/192.0.2.1", "ros2:ENDPOINT"),
        (f"{AT}?", "OPTION=VALUE"),
        (f"{AT}?domain", "OPTION=VALUE"),
        (f"{AT}?" + "&".join(["stale=1"] * 65), "OPTION=VALUE"),
        (f"{AT}?domain=%ff", "OPTION=VALUE"),
        (f"{AT}?domain=233", "from 0 to 232"),
        (f"{AT}?tolerance=0", "not a number above 0 and up to 0.1"),
        (f"{AT}?tolerance=0.2", "not a number above 0 and up to 0.1"),
        (f"{AT}?tolerance=1e-3", "not a number above 0 and up to 0.1"),
        (f"{AT}?domain=-1", "from 0 to 232"),
        (f"{AT}?meshes=/no/such/folder", "'/no/such/folder' is not a folder"),
        (f"{AT}?domain=1&domain=2", "'domain' is given 2 times"),
        (f"{AT}?Domain=1", "'Domain' is not an option"),
        (f"{AT}?namespace=arm", "not a ROS namespace"),
        (f"{AT}?namespace=/arm/", "not a ROS namespace"),
        (f"{AT}?states=", "not the name of a ROS topic"),
        (f"{AT}?states=/1", "not the name of a ROS topic"),
        (f"{AT}?states=a/**", "not the name of a ROS topic"),
        (f"{AT}?states={'a' * 300}", "not the name of a ROS topic"),
        (f"{AT}?stale=0", "from 0.05 to 10"),
        (f"{AT}?stale=nan", "from 0.05 to 10"),
        (f"{AT}?commands=", "not the name of a ROS topic"),
        (f"{AT}?commands=a:", "TOPIC:JOINT;JOINT"),
        (f"{AT}?commands=a:j;", "TOPIC:JOINT;JOINT"),
        (f"{AT}?commands=a:j&commands=b", "if there are several"),
        (f"{AT}?commands=a:j&commands=b:j", "may be given only once"),
        (f"{AT}?commands=a:j&commands=a:k", "may be given only once"),
    ],
)
def test_an_invalid_address_is_refused_with_the_valid_form(text: str, named: str) -> None:
    with pytest.raises(AddressError, match=named):
        parse_address(text)
