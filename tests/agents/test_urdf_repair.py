"""Common errors of real URDF files are repaired for the simulation, and logged."""

import logging
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from linked_fleet_agent.robots.catalogue import UnavailableError, load
from linked_fleet_agent.robots.mujoco_model import build, reason_of
from linked_fleet_agent.robots.urdf_repair import nearest_physical
from linked_fleet_agent.urdf import UrdfError, joints_of
from meshes import BOX, stl

SOUND = '<mass value="1"/><inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/>'
INDEFINITE = SOUND.replace('ixy="0"', 'ixy="0.5"')
NO_TRIANGLE = SOUND.replace('izz="0.1"', 'izz="0.9"')


def _link(name: str, inertial: str = SOUND) -> str:
    return f'<link name="{name}">{f"<inertial>{inertial}</inertial>" if inertial else ""}</link>'


def _joint(name: str, kind: str, child: str, more: str = "", parent: str = "world") -> str:
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f'<axis xyz="0 0 1"/><limit lower="-1" upper="1" velocity="1" effort="10"/>{more}</joint>'
    )


URDF = (
    '<robot name="all"><link name="world"/>'
    + _link("a", INDEFINITE)
    + _link("b", "")
    + _link("c", NO_TRIANGLE)
    + "".join(map(_link, "defg"))
    + _joint("turn", "revolute", "a")
    + _joint("spin", "continuous", "b")
    + _joint("slide", "prismatic", "c")
    + _joint("follow", "revolute", "d", '<mimic joint="turn" multiplier="-0.5" offset="0.1"/>')
    + _joint("weld", "fixed", "e")
    + _joint("free", "floating", "f")
    + _joint("plane", "planar", "g")
    + "</robot>"
)


def test_every_kind_of_joint_is_simulated_and_every_repair_is_logged(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """Indefinite, impossible and missing inertias are repaired; mimic joints follow; the text stays the original."""
    file = tmp_path / "all.urdf"
    file.write_text(URDF)
    with caplog.at_level(logging.INFO):
        robot = load("odd", str(file))
    facts = robot.describe()
    assert facts.urdf == URDF
    assert [joint.name for joint in facts.joints] == ["turn", "spin", "slide", "follow"]
    for named in ("link a:", "link b ", "link c:", "joint free", "joint plane"):
        assert any("odd: " in message and named in message for message in caplog.messages), named
    robot.read(0.0)
    robot.apply({"turn": 0.4, "spin": 2.0, "slide": 0.3})
    positions = [robot.read(step * 0.01).positions for step in range(400)][-1]
    assert positions == pytest.approx((0.4, 2.0, 0.3, -0.1), abs=5e-3)
    with pytest.raises(KeyError):
        robot.apply({"follow": 0.0})


def test_limits_of_a_continuous_joint_are_open() -> None:
    """A continuous joint has no limits, whatever its file says."""
    turn, spin, *_ = joints_of(URDF)
    assert (turn.limits.lower, turn.limits.upper) == (-1.0, 1.0)
    assert (spin.limits.lower, spin.limits.upper, spin.limits.velocity) == (None, None, 1.0)


@given(st.lists(st.floats(-10, 10), min_size=6, max_size=6))
def test_a_repaired_inertia_is_physical(values: list[float]) -> None:
    """All principal moments are positive and no one exceeds the sum of the others."""
    xx, yy, zz, xy, xz, yz = values
    a, b, c = np.linalg.eigvalsh(nearest_physical(np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])))
    assert a > 0.0
    assert a + b >= c * (1.0 - 1e-9)


@pytest.mark.parametrize("text", ["", "<html/>", "<robot><joint type='revolute'/></robot>"])
def test_an_invalid_urdf_is_refused_with_a_reason(text: str) -> None:
    """The error is one of the project's own types."""
    with pytest.raises(UrdfError):
        joints_of(text)


def test_an_unknown_robot_is_refused_naming_the_known() -> None:
    """The message lists the known robots."""
    with pytest.raises(UnavailableError, match="baxter"):
        load("x", "x")


def _body(inside: str) -> str:
    links = "".join(f'<link name="{name}">{inside}</link>' for name in "ab")
    ends = '<parent link="a"/><child link="b"/>'
    limit = '<limit lower="-1" upper="1"/>'
    return f'<robot name="r">{links}<joint name="j" type="revolute">{ends}{limit}</joint></robot>'


@pytest.mark.parametrize("floating", [False, True])
@pytest.mark.parametrize(
    "inside",
    [
        "",
        '<inertial><mass value="1"/></inertial>',
        '<inertial><mass value="0"/><inertia ixx="0" iyy="0" izz="0"/></inertial>',
        '<inertial><mass value="-1"/><inertia ixx="1" iyy="1" izz="1"/></inertial>',
        '<inertial><mass value="0.7"/><inertia ixx="2.7e-20" iyy="5.4e-20" izz="1.4e-20"/></inertial>',
        '<inertial><mass value="1e-20"/><inertia ixx="1e-20" iyy="1e-20" izz="1e-20"/></inertial>',
        '<inertial><mass value="heavy"/></inertial>',
        f'<inertial>{SOUND}</inertial><collision><geometry><sphere radius="-1"/></geometry></collision>',
        f'<inertial>{SOUND}</inertial><collision><geometry><box size="0 0 0"/></geometry></collision>',
        f"<inertial>{SOUND}</inertial><collision><geometry><cone/></geometry></collision>",
        f'<inertial>{SOUND}</inertial><collision><geometry><capsule radius="0.1" length="0.3"/></geometry></collision>',
    ],
)
def test_a_part_that_mujoco_would_refuse_without_a_name_costs_no_robot(
    inside: str, floating: bool, tmp_path: Path
) -> None:
    file = tmp_path / "r.urdf"
    file.write_text(_body(inside))
    reading = load("r", str(file), floating).read(0.0)
    assert np.isfinite(reading.positions).all()


def test_a_capsule_is_a_cylinder_and_two_spheres(tmp_path: Path) -> None:
    capsule = (
        '<origin xyz="1 0 0" rpy="0 1.5707963267948966 0"/><geometry><capsule radius="0.1" length="0.4"/></geometry>'
    )
    urdf = _body(f"<inertial>{SOUND}</inertial><collision>{capsule}</collision>")
    model = build(urdf, "r", joints_of(urdf), {}, "floating", None)
    shapes = [index for index in range(model.ngeom) if model.geom_bodyid[index] == model.body("b").id]
    assert [model.geom_size[index].tolist()[:2] for index in shapes] == [[0.1, 0.2], [0.1, 0], [0.1, 0]]
    assert model.geom_pos[shapes] == pytest.approx(np.array([[1, 0, 0], [0.8, 0, 0], [1.2, 0, 0]]))


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        (b"", "is empty"),
        (b"solid nonsense", "invalid header"),
        (stl([((0, 0, 0), (1, 0, 0), (0, 1, 0))]), "at least 4 vertices required"),
        (stl([tuple(tuple(1e-9 * c for c in corner) for corner in each) for each in BOX]), "surface area is too small"),
    ],
)
def test_a_mesh_that_mujoco_cannot_use_is_left_out_with_its_link_and_reason(
    content: bytes, reason: str, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """The sound ones stay. Meshes serve the ground that a floating robot stands on."""
    (tmp_path / "bad.stl").write_bytes(content)
    (tmp_path / "good.stl").write_bytes(stl(BOX))
    shapes = "".join(
        f'<collision><geometry><mesh filename="{name}"/></geometry></collision>' for name in ("bad.stl", "good.stl")
    )
    urdf = _body(f"<inertial>{SOUND}</inertial>{shapes}")
    model = build(urdf, "r", joints_of(urdf), {}, "floating", tmp_path / "r.urdf")
    assert model.nmesh == 1
    (said,) = {each for each in caplog.messages if "left out" in each and "link a" in each}
    assert "r: link a: collision mesh 'bad.stl' is left out: " in said and reason in said
    assert "Element" not in said and "id 0" not in said


def test_a_reason_of_mujoco_has_no_number_of_a_text_that_nobody_wrote() -> None:
    assert (
        reason_of(ValueError("Error: mass is too small\nElement name 'arm', id 3, line 17"))
        == "mass is too small (arm)"
    )
    assert reason_of(ValueError("Error: mass is too small\nElement name '', id 0")) == "mass is too small"
    assert reason_of(ValueError("XML Error: bad value at line 3, column 4")) == "XML Error: bad value"
