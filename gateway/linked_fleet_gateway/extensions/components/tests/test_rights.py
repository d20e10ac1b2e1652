"""Rights on components: acting, and letting a robot move again after a protective stop, which is a right of its own."""

from pathlib import Path

import pytest

from authenticated_gateway import run_authenticated
from component_cell import Lamp
from linked_fleet_agent.components import Component, action
from linked_fleet_agent.robots.of_components import RobotOfComponents
from running import eventually
from virtual.processes import serving_robot

pytestmark = pytest.mark.virtual


class Guard(Component):
    """Keeps the robot still until somebody resets it."""

    def __init__(self) -> None:
        self.resets = 0

    @action(kind="https://w3id.org/linked-fleet#ResetProtectiveStop")
    async def reset(self) -> None:
        """Let it move again."""
        self.resets += 1


def test_who_may_act_may_not_reset_a_protective_stop(tmp_path: Path) -> None:
    guard, lamp = Guard(), Lamp()
    with run_authenticated(tmp_path, robots=False) as here:
        here.add("mover", "read", "act")
        here.add("keeper", "read", "reset")
        here.known("keeper")
        robot = RobotOfComponents("Cell", guard, lamp)
        with (
            serving_robot(here.place.zenoh, "cell", robot),
            here.browsing("mover") as mover,
            here.browsing("keeper") as keeper,
        ):
            root = here.root + "cell/"
            eventually(lambda: mover.http.get(root + "guard").status_code == 200, "the component")
            assert mover.http.post(root + "guard/actions/reset").status_code == 403
            assert keeper.http.post(root + "lamp/actions/on", json={"value": True}).status_code == 403
            assert not guard.resets
            assert keeper.http.post(root + "guard/actions/reset", headers={"prefer": "wait=5"}).status_code == 204
            assert guard.resets == 1
            answer = mover.http.post(root + "lamp/actions/on", json={"value": True}, headers={"prefer": "wait=5"})
            assert answer.status_code == 204 and lamp.lit
