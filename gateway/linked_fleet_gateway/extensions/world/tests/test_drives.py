"""Bases that drive at random among crates and each other touch nothing, whatever is asked of them."""

import itertools
import math
import os
import random
from pathlib import Path

import msgspec
import pytest

from carts import add_cart, cart_urdf, frame
from floor_shapes import Corners, overlap, rectangle
from linked_fleet_agent.planar import DriveLimits, Pose, Ramp, Velocity
from linked_fleet_agent.wire.messages import Mesh
from linked_fleet_gateway.actions.plan import Act, Motion, RobotTime, slowed
from linked_fleet_gateway.app.application import create_live
from linked_fleet_gateway.app.settings import GatewaySettings
from linked_fleet_gateway.extensions.models.meshes import Meshes
from linked_fleet_gateway.extensions.world import checks, nearby
from linked_fleet_gateway.extensions.world.checks import Checks
from linked_fleet_gateway.extensions.world.collisions import Collides
from linked_fleet_gateway.extensions.world.scene import Box, SceneObject
from linked_fleet_identity.rights import ALL
from linked_fleet_state.driving import REACTION_S, Drive
from linked_fleet_state.model import Pose as Pose3
from virtual.zenoh_network import ZenohNetwork

LIMITS = DriveLimits(linear=1.0, angular=1.5, linear_acceleration=1.0, angular_acceleration=2.0)
LENGTH_M, WIDTH_M, CRATE_M, TICK_S = 0.5, 0.4, 0.3, 0.01
SEEDS = range(40 if "LONG_TESTS" in os.environ else 1)
DRIVES, DRIVES_IN_ONE_WORLD = 250, 50
"""Of each seed, and among the same crates."""
URDF = cart_urdf(LENGTH_M, WIDTH_M)


class Cart:
    """A base that drives as its agent would let it. Requests take a while to arrive."""

    def __init__(self, name: str, chance: random.Random) -> None:
        self.name, self.chance = name, chance
        self.at, self.ramp, self.now_s = Pose(), Ramp(LIMITS), 0.0
        self.coming: list[tuple[float, Drive]] = []

    def request(self, drive: Drive) -> None:
        self.coming.append((self.now_s + self.chance.uniform(0.0, REACTION_S), drive))

    def tick(self) -> None:
        self.now_s += TICK_S
        while self.coming and self.coming[0][0] <= self.now_s:
            _, drive = self.coming.pop(0)
            self.ramp.request(drive.velocity, self.now_s + drive.duration_s)
        way = self.ramp.step(self.now_s, TICK_S)
        self.at = self.at.moved(way.linear * TICK_S, way.angular * TICK_S)

    @property
    def corners(self) -> Corners:
        return rectangle(self.at, LENGTH_M, WIDTH_M)


class Floor:
    """Two carts, and the checks of their drives."""

    def __init__(self, folder: Path, chance: random.Random) -> None:
        self.live = create_live(GatewaySettings(), ZenohNetwork().gateway("g"))
        self.objects: dict[str, SceneObject] = {}
        self.checks = Checks(self.live, Meshes(self._ask), self.objects, folder)
        self.chance = chance
        self.carts = [Cart("a", chance), Cart("b", chance)]
        self.checks._driving._now_s = lambda: self.carts[0].now_s
        for cart in self.carts:
            add_cart(self.live, cart.name, URDF)
        self.sequence = 0

    async def _ask(self, robot: str, mesh: Mesh, timeout_s: float) -> bytes:
        raise AssertionError("it has no meshes")

    def frames(self) -> None:
        for cart in self.carts:
            self.sequence += 1
            told = frame(cart.name, self.sequence, cart.at, cart.ramp.velocity, monotonic_ns=self.sequence)
            self.live.fleet.apply(told, 1)

    def scatter(self) -> None:
        """Put crates and carts where they do not touch."""
        taken: list[Corners] = []
        self.objects.clear()
        for number in range(8):
            at = self._free(taken, CRATE_M, CRATE_M)
            pose = Pose3((at.x, at.y, 0.3), (0.0, 0.0, math.sin(at.heading / 2), math.cos(at.heading / 2)))
            self.objects[f"c{number}"] = SceneObject(
                title=f"crate {number}", kind="obstacle", pose=pose, geometry=Box((CRATE_M, CRATE_M, 0.6))
            )
        self.crates = list(taken)
        for cart in self.carts:
            cart.at, cart.ramp, cart.coming = self._free(taken, LENGTH_M + 0.1, WIDTH_M + 0.1), Ramp(LIMITS), []
        self.checks._driving._begun.clear()

    def _free(self, taken: list[Corners], length_m: float, width_m: float) -> Pose:
        while True:
            x, y = self.chance.uniform(-2.5, 2.5), self.chance.uniform(-2.5, 2.5)
            at = Pose(x, y, self.chance.uniform(-math.pi, math.pi))
            corners = rectangle(at, length_m, width_m)
            if not any(overlap(corners, each) for each in taken):
                taken.append(corners)
                return at

    async def ask(self, cart: Cart, drive: Drive) -> float:
        """Request a drive. Return the share of its speed that the check allows; 0 if it is refused."""
        robot = self.live.fleet.robots[cart.name]
        act = Act("mobile_base", msgspec.json.encode(drive.input), "drive", moves=("base",), drive=drive)
        motion = Motion(robot, act, {}, RobotTime(1, 1))
        try:
            found = await self.checks.check_path(motion, ALL, "drive")
        except Collides:
            return 0.0
        allowed = slowed(motion, found.speed_share).motion
        assert isinstance(allowed, Act) and allowed.drive is not None
        cart.request(allowed.drive)
        return found.speed_share

    def tick(self) -> None:
        for cart in self.carts:
            cart.tick()
        one, other = (cart.corners for cart in self.carts)
        assert not overlap(one, other), "the carts touch"
        for corners, crate in itertools.product((one, other), self.crates):
            assert not overlap(corners, crate), "a cart touches a crate"

    def drive(self) -> Drive:
        velocity = Velocity(self.chance.uniform(-1, 1), 0.0, self.chance.uniform(-1.5, 1.5))
        straight = Velocity(velocity.linear, 0.0, 0.0)
        return Drive(self.chance.choice((velocity, straight)), self.chance.uniform(0.1, 1.0), LIMITS)


@pytest.fixture(autouse=True)
def _patience(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(nearby, "EARLY_S", 60.0)
    monkeypatch.setattr(checks, "_TIMEOUT_S", 60.0)


@pytest.mark.parametrize("seed", SEEDS)
async def test_random_drives_touch_nothing(tmp_path: Path, seed: int) -> None:
    """10,000 in the long tests."""
    chance = random.Random(seed)
    floor, shares = Floor(tmp_path, chance), list[float]()
    async with floor.checks:
        for number in range(DRIVES):
            if number % DRIVES_IN_ONE_WORLD == 0:
                floor.scatter()
            floor.frames()
            shares.append(await floor.ask(chance.choice(floor.carts), floor.drive()))
            for _ in range(round(chance.uniform(0.05, 1.0) / TICK_S)):
                floor.tick()
    assert shares.count(1.0) > DRIVES / 4
    assert any(0.0 < share < 1.0 for share in shares)
