"""A robot that its agent cannot use, or that is away: the other robots of the agent do not notice."""

from collections.abc import Iterator
from pathlib import Path

import pytest

from running import process
from small_fleet import Place, faulty, live

pytestmark = pytest.mark.virtual

SOUND = """<robot name="door"><link name="frame"/><link name="leaf">
<inertial><mass value="1"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial></link>
<joint name="hinge" type="revolute"><parent link="frame"/><child link="leaf"/><axis xyz="0 0 1"/>
<limit lower="0" upper="1.6" effort="20" velocity="1"/></joint></robot>"""


@pytest.fixture
def place(tmp_path: Path) -> Iterator[Place]:
    yield Place(tmp_path / "state")


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        (None, "neither one of"),
        ("<robot name='door'><link", "is not a URDF"),
        ("<html/>", "is not a URDF"),
    ],
)
def test_a_robot_that_cannot_be_used_is_shown_and_used_once_it_can(
    place: Place, tmp_path: Path, content: str | None, reason: str
) -> None:
    file = tmp_path / "door.urdf" if content is not None else tmp_path / "door"
    if content is not None:
        file.write_text(content)
    with place.gateway() as (_, browser):
        robots = f"--robot=ur5,door={file}"
        with process("-m", "linked_fleet_agent", robots, "--connect", place.zenoh) as agent:
            live(browser, "ur5")
            assert reason in faulty(browser, "door")
            agent.said("the robot is tried again in 4 s")
            if content is not None:
                file.write_text(SOUND)
                live(browser, "door")
                live(browser, "ur5")
                assert "another agent of this name" not in agent.output


def test_a_name_that_is_taken_costs_only_its_robot(place: Place, tmp_path: Path) -> None:
    file = tmp_path / "door.urdf"
    file.write_text(SOUND)
    agents = ("-m", "linked_fleet_agent", "--connect", place.zenoh)
    with place.gateway() as (_, browser), process(*agents, f"--robot=door={file}") as holder:
        live(browser, "door")
        with process(*agents, f"--robot=door={file},ur5") as agent:
            live(browser, "ur5")
            agent.said("is taken: another agent")
            agent.said("the others go on")
            holder.stop()
            agent.said("door: a gateway is present")
            live(browser, "door")
            live(browser, "ur5")


def test_an_agent_without_any_usable_robot_ends_with_the_reasons(place: Place, tmp_path: Path) -> None:
    file = tmp_path / "door.urdf"
    file.write_text("<html/>")
    with process("-m", "linked_fleet_agent", f"--robot=door={file},gate=nothing", "--connect", place.zenoh) as agent:
        assert agent.ended() == 2
        assert "is not a URDF" in agent.output and "'nothing' is neither one of" in agent.output
