"""An arm that is to move while its base follows a path is checked along the rest of that path."""

import math
from pathlib import Path
from typing import Self

import pytest

from linked_fleet_agent.components.driving import planar_base
from linked_fleet_agent.planar import Pose, Velocity
from linked_fleet_agent.wire.codec import encode_state, layout
from linked_fleet_agent.wire.messages import Description, Follow, Mesh, Move, State
from linked_fleet_gateway.actions.plan import Motion, RobotTime
from linked_fleet_gateway.app.application import create_live
from linked_fleet_gateway.app.settings import GatewaySettings
from linked_fleet_gateway.extensions.models.meshes import Meshes
from linked_fleet_gateway.extensions.world.checks import Checks
from linked_fleet_gateway.extensions.world.collisions import Collides
from linked_fleet_gateway.extensions.world.placement import PLACEMENT, encode_placement
from linked_fleet_gateway.extensions.world.scene import Box, SceneObject
from linked_fleet_identity.rights import ALL
from linked_fleet_state.driving import FollowedPath
from linked_fleet_state.events import Appeared, Described, Framed
from linked_fleet_state.model import Pose as Pose3
from virtual.zenoh_network import ZenohNetwork

UPRIGHT = (0.0, 0.0, 0.0, 1.0)
URDF = """<robot name="robot">
<link name="base"><collision><origin xyz="0 0 0.2"/><geometry><box size="0.5 0.4 0.3"/></geometry></collision></link>
<link name="arm"><collision><origin xyz="0.3 0 0"/><geometry><box size="0.6 0.1 0.1"/></geometry></collision></link>
<joint name="turn" type="revolute"><parent link="base"/><child link="arm"/><origin xyz="0 0 0.5"/><axis xyz="0 0 1"/>
<limit lower="-3" upper="3" velocity="2" effort="10"/></joint></robot>"""
LEFT = Move({"turn": math.pi / 2})
OUT_AND_BACK = Follow(("turn",), (1.0, 2.0), ((math.pi / 2,), (0.0,)))
PATH = FollowedPath((Pose(4.0, 0.0, 0.0),))


class Hall:
    """A robot at the origin with its arm ahead, and a crate beside its way."""

    def __init__(self, folder: Path) -> None:
        self.live = create_live(GatewaySettings(), ZenohNetwork().gateway("g"))
        self.objects = dict[str, SceneObject]()
        self.checks = Checks(self.live, Meshes(self._ask), self.objects, folder)
        described = Description(
            version=1, robot="r", incarnation=1, title="r", urdf=URDF, joints=("turn",), rate_hz=100, capabilities=(),
            layout=layout(1, True), base="floating",
        )  # fmt: skip
        for event in (Appeared("r", 1), Described(described)):
            self.live.fleet.apply(event, 1)
        self.robot = self.live.fleet.robots["r"]
        self.robot.settings = {PLACEMENT: encode_placement(Pose3((0.0, 0.0, 0.0), UPRIGHT), accepts_unchecked=False)}
        self.checks._driving._now_s = lambda: 0.0
        self.stand(0.0)

    async def __aenter__(self) -> Self:
        await self.checks.__aenter__()
        return self

    async def __aexit__(self, *_: object) -> None:
        await self.checks.__aexit__(None, None, None)

    async def _ask(self, robot: str, mesh: Mesh, timeout_s: float) -> bytes:
        raise AssertionError("it has no meshes")

    def stand(self, x: float) -> None:
        base = planar_base(Pose(x), Velocity(0.5))
        sequence = 1 if self.robot.frame is None else self.robot.frame.sequence + 1
        told = State(
            incarnation=1, sequence=sequence, monotonic_ns=sequence, wall_ns=1, positions=(0.0,), velocities=(0.0,),
            efforts=(math.nan,), base=base,
        )  # fmt: skip
        self.live.fleet.apply(Framed("r", encode_state(told)), 1)

    def put_crate(self, x: float, y: float) -> None:
        box = Box((0.2, 0.2, 1.0))
        self.objects["c"] = SceneObject(title="crate", kind="obstacle", pose=Pose3((x, y, 0.5), UPRIGHT), geometry=box)

    async def check(self, moved: Move | Follow) -> bool:
        """Return True if a motion of the arm is found free."""
        motion = Motion(self.robot, moved, {"turn": math.pi / 2}, RobotTime(1, 1))
        await self.checks.wait_until_ready(self.robot, ALL)
        try:
            return (await self.checks.check_path(motion, ALL, "arm")).free
        except Collides as error:
            assert "arm" in error.detail and "crate" in error.detail
            return False


@pytest.mark.parametrize("motion", [LEFT, OUT_AND_BACK])
async def test_an_arm_does_not_reach_out_where_the_base_will_pass(tmp_path: Path, motion: Move | Follow) -> None:
    async with Hall(tmp_path) as hall:
        hall.put_crate(3.0, 0.45)
        assert await hall.check(motion), "the base goes nowhere near it"
        hall.checks._driving.follow(hall.robot, PATH)
        assert not await hall.check(motion)
        hall.put_crate(3.0, 0.9)
        assert await hall.check(motion), "the crate is out of its reach"


async def test_what_the_base_has_passed_does_not_matter(tmp_path: Path) -> None:
    async with Hall(tmp_path) as hall:
        hall.put_crate(-0.7, 0.45)
        hall.checks._driving.follow(hall.robot, PATH)
        assert await hall.check(LEFT)
        hall.stand(3.9)
        hall.put_crate(3.0, 0.45)
        assert await hall.check(LEFT)
