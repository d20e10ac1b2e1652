"""Processor time of the guard while a hundred robots drive: frames with their poses, checks and watches of their paths.

The robots drive to and fro on lanes that are 1.5 m apart, so that each has neighbours that move.
"""

import asyncio
import math
import os
import tempfile
import time
from dataclasses import dataclass, field
from pathlib import Path

from bench.scene import process_cpu_s
from bench.table import Row, bounded, known
from carts import add_cart, cart_urdf, frame
from linked_fleet_agent.planar import DriveLimits, Pose, Velocity
from linked_fleet_agent.wire.components import BASE
from linked_fleet_agent.wire.messages import Mesh
from linked_fleet_gateway.actions.plan import Act, Motion, RobotTime
from linked_fleet_gateway.app.application import create_live
from linked_fleet_gateway.app.settings import GatewaySettings
from linked_fleet_gateway.extensions.models.meshes import Meshes
from linked_fleet_gateway.extensions.world.checks import Checks
from linked_fleet_gateway.extensions.world.path_watch import PathWatch
from linked_fleet_identity.rights import ALL
from linked_fleet_state.driving import FollowedPath
from linked_fleet_state.events import Framed
from linked_fleet_state.invocation import Invocation
from virtual.zenoh_network import ZenohNetwork

COUNT, ROWS = 100, 10
SPEED_M_S, LANE_M, APART_M, RATE_HZ = 0.5, 8.0, 1.5, 20.0
MOST_CORES = 0.5
LIMITS = DriveLimits(linear=1.0, angular=1.5, linear_acceleration=1.0, angular_acceleration=2.0)
URDF = cart_urdf(0.5, 0.4)


@dataclass
class Part:
    """The base of a robot, as far as the guard asks for it."""

    path_ahead: FollowedPath | None = None
    drive_limits: DriveLimits = LIMITS
    battery_percent: float | None = None
    offers: dict[str, object] = field(default_factory=dict)


@dataclass
class Cart:
    name: str
    x: float
    y: float
    part: Part = field(default_factory=Part)
    sequence: int = 0
    turned: bool = False
    drives: int = 0

    def path(self) -> FollowedPath:
        """Return the way to the other end of its lane."""
        end = -LANE_M / 2 if self.turned else LANE_M / 2
        centre = round(self.x / (LANE_M + APART_M)) * (LANE_M + APART_M)
        return FollowedPath((Pose(centre + end, self.y, math.nan),), limits=LIMITS)

    def drive(self, elapsed_s: float) -> None:
        assert self.part.path_ahead is not None
        (end,) = self.part.path_ahead.poses
        step = SPEED_M_S * elapsed_s
        if abs(end.x - self.x) <= step:
            self.x, self.part.path_ahead, self.turned = end.x, None, not self.turned
        else:
            self.x += math.copysign(step, end.x - self.x)

    def frame(self) -> Framed:
        self.sequence += 1
        pose = Pose(self.x, self.y, math.pi if self.turned else 0.0)
        velocity = Velocity(SPEED_M_S if self.part.path_ahead else 0.0)
        return frame(self.name, self.sequence, pose, velocity, monotonic_ns=time.monotonic_ns())


class Fleet:
    def __init__(self, folder: Path) -> None:
        self.live = create_live(GatewaySettings(), ZenohNetwork().gateway("g"))
        self.checks = Checks(self.live, Meshes(self._ask), {}, folder)
        self.watch = PathWatch(self.checks, self.live.fleet.robots, self._open_of, self._cancel)
        self.ended, self.checked = 0, 0
        self.carts = [self._cart(number) for number in range(COUNT)]

    async def _ask(self, robot: str, mesh: Mesh, timeout_s: float) -> bytes:
        raise AssertionError("it has no meshes")

    def _cart(self, number: int) -> Cart:
        lane, place = divmod(number, COUNT // ROWS)
        cart = Cart(f"r{number}", place * (LANE_M + APART_M), lane * APART_M)
        robot = add_cart(self.live, cart.name, URDF)
        robot.parts = {"base": cart.part}
        return cart

    def _open_of(self, robot: str) -> list[Invocation]:
        id = f"{robot} {self.carts[int(robot[1:])].drives}"
        return [Invocation(id=id, robot=robot, action="", targets={}, created_ns=0, deadline_ns=0, moves=(BASE,))]

    async def _cancel(self, id: str, reason: str) -> bool:
        self.ended += 1
        self.carts[int(id[1:].split()[0])].part.path_ahead = None
        return True

    def spent_s(self) -> float:
        """Return the processor time of this process and of the one that checks."""
        checking = self.checks._checker._process._worker.process.pid
        return process_cpu_s(os.getpid()) + process_cpu_s(checking)

    async def begin(self, cart: Cart) -> None:
        """Let the guard check the way back, and drive it."""
        robot, path = self.live.fleet.robots[cart.name], cart.path()
        cart.drives += 1
        motion = Motion(robot, Act("base", b"{}", "followPath", moves=(BASE,), path=path), {}, RobotTime(1, 1))
        await self.checks.wait_until_ready(robot, ALL)
        await self.checks.check_path(motion, ALL, cart.name)
        cart.part.path_ahead = path
        self.checked += 1

    async def play(self, seconds: float) -> None:
        due = time.monotonic()
        for _ in range(round(seconds * RATE_HZ)):
            due += 1 / RATE_HZ
            for cart in self.carts:
                if cart.part.path_ahead is None:
                    await self.begin(cart)
                cart.drive(1 / RATE_HZ)
                self.live.fleet.apply(cart.frame(), 1)
            await asyncio.sleep(max(0.0, due - time.monotonic()))


async def _measure(seconds: float) -> list[Row]:
    with tempfile.TemporaryDirectory() as folder:
        fleet = Fleet(Path(folder))
        async with fleet.checks, fleet.watch:
            for cart in fleet.carts:
                fleet.live.fleet.apply(cart.frame(), 1)
            await fleet.play(2.0)  # which prepares the shapes, and begins all drives
            before, began_s, checked = fleet.spent_s(), time.monotonic(), fleet.checked
            await fleet.play(seconds)
            passed_s = time.monotonic() - began_s
            spent_s = fleet.spent_s() - before
    return [
        bounded(f"{COUNT} driving robots: guard and poses", "cores", spent_s / passed_s, MOST_CORES),
        known("paths checked meanwhile", "1/s", (fleet.checked - checked) / passed_s),
        known("drives that were ended", "", fleet.ended),
    ]


def rows(seconds: float, least_s: float = 10.0) -> list[Row]:
    return asyncio.run(_measure(max(seconds, least_s)))
