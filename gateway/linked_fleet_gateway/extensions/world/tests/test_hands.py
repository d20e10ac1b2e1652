"""Which links are the hands of a robot, and which may touch what a link holds."""

from dataclasses import dataclass, field

import pytest

from linked_fleet_gateway.extensions.world.hands import hand_around, hands_of, palm_of
from linked_fleet_state.gripper import Gripper
from linked_fleet_state.model import RobotModel

CHAIN = ("base", "upper", "lower", "flange")


def joint(name: str, kind: str, parent: str, child: str, more: str = "") -> str:
    ends = f'<parent link="{parent}"/><child link="{child}"/>'
    limit = '<limit lower="0" upper="1" velocity="1" effort="1"/>' if kind == "prismatic" else ""
    return f'<joint name="{name}" type="{kind}">{ends}<axis xyz="0 0 1"/>{limit}{more}</joint>'


LINKS = (*CHAIN, "palm", "camera", "left", "right", "pad")
URDF = (
    '<robot name="r">'
    + "".join(f'<link name="{each}"/>' for each in LINKS)
    + "".join(joint(f"j{n}", "continuous", CHAIN[n], CHAIN[n + 1]) for n in range(3))
    + joint("mount", "fixed", "flange", "palm")
    + joint("eye", "fixed", "palm", "camera")
    + joint("close", "prismatic", "palm", "left")
    + joint("follow", "prismatic", "palm", "right", "<mimic joint='close'/>")
    + joint("rubber", "fixed", "left", "pad")
    + "</robot>"
)
MODEL = RobotModel.parse(URDF)
HAND = {"flange", "palm", "camera", "left", "right", "pad"}


@dataclass
class Part:
    gripper: Gripper | None


@dataclass
class Arm:
    """The part of a robot that hands depend on."""

    parts: dict[str, Part] = field(default_factory=dict)
    model: RobotModel = MODEL
    commanded: tuple[str, ...] = ("j0", "j1", "j2")


GRIPPER = Gripper(("close",))
WITH, WITHOUT = Arm({"lamp": Part(None), "gripper": Part(GRIPPER)}), Arm()


def test_the_hand_is_the_gripper_and_what_is_fixed_to_it() -> None:
    assert hands_of(WITH) == HAND  # type: ignore[arg-type]
    assert palm_of(MODEL, GRIPPER) == "palm"


def test_without_a_gripper_the_hand_is_what_the_last_joint_carries() -> None:
    assert hands_of(WITHOUT) == HAND  # type: ignore[arg-type]
    assert hands_of(Arm(commanded=("j0", "j1"))) == {"lower", *HAND}  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("arm", "link", "hand"),
    [
        (WITH, "palm", {"lower", *HAND}),
        (WITHOUT, "palm", {"lower", *HAND}),
        (WITH, "left", HAND),
        (WITHOUT, "left", {"left", "pad", "palm", "flange", "camera"}),
        (WITH, "upper", {"base", "upper", "lower"}),
    ],
)
def test_what_a_link_holds_may_touch_the_links_within_one_joint_and_its_gripper(
    arm: Arm, link: str, hand: set[str]
) -> None:
    assert hand_around(arm, link) == hand  # type: ignore[arg-type]


def test_a_gripper_that_moves_no_joint_has_no_palm() -> None:
    assert palm_of(MODEL, Gripper(("gone",))) == ""
