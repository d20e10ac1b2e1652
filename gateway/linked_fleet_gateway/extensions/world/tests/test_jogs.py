"""Arms that are jogged at random among crates and each other touch nothing: joints one by one, and hands by streams."""

import itertools
import math
import os
import random
from collections.abc import Iterator, Mapping
from pathlib import Path

import msgspec
import numpy as np
import pytest

from floor_shapes import Corners, overlap, rectangle
from linked_fleet_agent.joint_ramp import toward
from linked_fleet_agent.planar import Pose
from linked_fleet_agent.wire.codec import encode_state, layout
from linked_fleet_agent.wire.messages import Description, Mesh, State
from linked_fleet_gateway.actions.plan import Act, Motion, RobotTime, slowed
from linked_fleet_gateway.app.application import create_live
from linked_fleet_gateway.app.settings import GatewaySettings
from linked_fleet_gateway.extensions.models.meshes import Meshes
from linked_fleet_gateway.extensions.world import checks, nearby
from linked_fleet_gateway.extensions.world.checks import Checks
from linked_fleet_gateway.extensions.world.collisions import Collides
from linked_fleet_gateway.extensions.world.placement import PLACEMENT, encode_placement
from linked_fleet_gateway.extensions.world.scene import Box, SceneObject
from linked_fleet_identity.rights import ALL
from linked_fleet_state.driving import REACTION_S
from linked_fleet_state.events import Appeared, Described, Framed
from linked_fleet_state.jogging import JointDrive
from linked_fleet_state.model import Pose as Pose3
from virtual.zenoh_network import ZenohNetwork

JOINTS = ("shoulder", "elbow", "wrist")
LINK_M, WIDTH_M, HIGH_M, CRATE_M, APART_M, TICK_S = 0.5, 0.08, 0.5, 0.2, 1.2, 0.01
MOST_RAD_S, MOST_M_S = 1.5, 0.5
ACCELERATIONS = dict.fromkeys(JOINTS, 3.0)
SAMPLE_S, SILENCE_S = 1 / 30, 0.2
SEEDS = range(20) if "LONG_TESTS" in os.environ else (9,)
JOGS, JOGS_IN_ONE_WORLD, SAMPLES = 100, 20, 8
"""Of each seed, among the same crates, and samples of a hand that is jogged."""
UPRIGHT = (0.0, 0.0, 0.0, 1.0)


def urdf() -> str:
    """Return an arm of which all links move in one plane."""
    box = f'<box size="{LINK_M} {WIDTH_M} 0.1"/>'
    shape = f'<collision><origin xyz="{LINK_M / 2} 0 0"/><geometry>{box}</geometry></collision>'
    links, joints = '<link name="root"/>', ""
    for number, name in enumerate(JOINTS):
        parent, at = (JOINTS[number - 1], f"{LINK_M} 0 0") if number else ("root", f"0 0 {HIGH_M}")
        links += f'<link name="link {name}">{shape}</link>'
        joints += (
            f'<joint name="{name}" type="continuous"><parent link="{f"link {parent}" if number else parent}"/>'
            f'<child link="link {name}"/><origin xyz="{at}"/><axis xyz="0 0 1"/></joint>'
        )
    return f'<robot name="arm">{links}{joints}</robot>'


class Arm:
    """Joints that move as their agent would let them. Requests take a while to arrive."""

    def __init__(self, name: str, x: float, chance: random.Random) -> None:
        self.name, self.x, self.chance, self.now_s = name, x, chance, 0.0
        self.place([0.0] * len(JOINTS))

    def place(self, positions: list[float]) -> None:
        self.positions = dict(zip(JOINTS, positions, strict=True))
        self.velocities, self.wanted = dict.fromkeys(JOINTS, 0.0), dict[str, float]()
        self.until_s, self.coming = 0.0, list[tuple[float, JointDrive]]()

    def request(self, drive: JointDrive) -> None:
        self.coming.append((self.now_s + self.chance.uniform(0.0, REACTION_S), drive))

    def tick(self) -> None:
        self.now_s += TICK_S
        while self.coming and self.coming[0][0] <= self.now_s:
            _, drive = self.coming.pop(0)
            self.wanted, self.until_s = drive.velocities, self.now_s + drive.duration_s
        before, wanted = self.velocities, self.wanted if self.now_s < self.until_s else {}
        self.velocities = toward(before, wanted, ACCELERATIONS, TICK_S)
        for name in JOINTS:
            self.positions[name] += TICK_S / 2 * (before[name] + self.velocities[name])

    def links(self) -> Iterator[Pose]:
        """Yield where the links begin, and then the tip."""
        at, heading = Pose(self.x), 0.0
        for name in JOINTS:
            heading += self.positions[name]
            yield (at := at._replace(heading=heading))
            at = at.moved(LINK_M, 0.0)
        yield at

    @property
    def shapes(self) -> list[Corners]:
        return [rectangle(at.moved(LINK_M / 2, 0.0), LINK_M, WIDTH_M) for at in list(self.links())[:-1]]

    @property
    def folded(self) -> bool:
        first, _, last = self.shapes
        return overlap(first, last)

    def of_hand(self, x: float, y: float) -> dict[str, float]:
        """Return the velocities of the joints that move the tip like this, damped where it can hardly move."""
        *starts, tip = self.links()
        jacobian = np.array([(at.y - tip.y, tip.x - at.x) for at in starts]).T
        found = jacobian.T @ np.linalg.solve(jacobian @ jacobian.T + 0.01 * np.eye(2), (x, y))
        found *= min(1.0, MOST_RAD_S / max(np.abs(found).max(), 1e-9))
        return dict(zip(JOINTS, found.tolist(), strict=True))


class Cell:
    """Two arms, and the checks of their jogging."""

    def __init__(self, folder: Path, chance: random.Random) -> None:
        self.live = create_live(GatewaySettings(), ZenohNetwork().gateway("g"))
        self.objects, self.crates, self.sequence = dict[str, SceneObject](), list[Corners](), 0
        self.checks = Checks(self.live, Meshes(self._ask), self.objects, folder)
        self.chance = chance
        self.arms = [Arm("a", 0.0, chance), Arm("b", APART_M, chance)]
        self.checks._jogs._now_s = lambda: self.arms[0].now_s
        for arm in self.arms:
            self._add(arm)

    async def _ask(self, robot: str, mesh: Mesh, timeout_s: float) -> bytes:
        raise AssertionError("it has no meshes")

    def _add(self, arm: Arm) -> None:
        described = Description(
            version=1, robot=arm.name, incarnation=1, title=arm.name, urdf=urdf(), joints=JOINTS, rate_hz=100,
            capabilities=(), layout=layout(len(JOINTS), False),
        )  # fmt: skip
        for event in (Appeared(arm.name, 1), Described(described)):
            self.live.fleet.apply(event, 1)
        place = Pose3((arm.x, 0.0, 0.0), UPRIGHT)
        self.live.fleet.robots[arm.name].settings = {PLACEMENT: encode_placement(place, accepts_unchecked=False)}

    def frames(self) -> None:
        for arm in self.arms:
            self.sequence += 1
            positions, velocities = (tuple(each.values()) for each in (arm.positions, arm.velocities))
            told = State(
                incarnation=1, sequence=self.sequence, monotonic_ns=self.sequence, wall_ns=1, positions=positions,
                velocities=velocities, efforts=(math.nan,) * len(JOINTS),
            )  # fmt: skip
            self.live.fleet.apply(Framed(arm.name, encode_state(told)), 1)

    def scatter(self) -> None:
        """Put arms and crates where they do not touch."""
        self.objects.clear()
        self.checks._jogs._begun.clear()
        self._fold_arms()
        arms = [shape for arm in self.arms for shape in arm.shapes]
        self.crates = []
        while len(self.crates) < 10:
            at = Pose(self.chance.uniform(-1.5, APART_M + 1.5), self.chance.uniform(-1.5, 1.5), self.chance.random())
            if not any(overlap(rectangle(at, CRATE_M + 0.05, CRATE_M + 0.05), each) for each in arms):
                self._put(at)

    def _fold_arms(self) -> None:
        while True:
            for arm in self.arms:
                arm.place([self.chance.uniform(-math.pi, math.pi) for _ in JOINTS])
            one, other = (arm.shapes for arm in self.arms)
            if not self._touch(one, other) and not any(arm.folded for arm in self.arms):
                return

    def _put(self, at: Pose) -> None:
        pose = Pose3((at.x, at.y, HIGH_M), (0.0, 0.0, math.sin(at.heading / 2), math.cos(at.heading / 2)))
        self.objects[f"c{len(self.crates)}"] = SceneObject(
            title="crate", kind="obstacle", pose=pose, geometry=Box((CRATE_M, CRATE_M, 0.4))
        )
        self.crates.append(rectangle(at, CRATE_M, CRATE_M))

    @staticmethod
    def _touch(ones: list[Corners], others: list[Corners]) -> bool:
        return any(overlap(*each) for each in itertools.product(ones, others))

    async def ask(self, arm: Arm, velocities: Mapping[str, float], duration_s: float) -> float:
        """Request jogging. Return the share of its speed that the check allows; 0 if it is refused."""
        self.frames()
        drive = JointDrive(dict(velocities), duration_s, ACCELERATIONS)
        act = Act("jogging", msgspec.json.encode(drive.input), "jogJoints", moves=JOINTS, drive=drive)
        motion = Motion(self.live.fleet.robots[arm.name], act, {}, RobotTime(1, 1))
        try:
            found = await self.checks.check_path(motion, ALL, "jog")
        except Collides:
            return 0.0
        allowed = slowed(motion, found.speed_share).motion
        assert isinstance(allowed, Act) and isinstance(allowed.drive, JointDrive)
        arm.request(allowed.drive)
        return found.speed_share

    async def jog_joints(self, arm: Arm) -> list[float]:
        moved = self.chance.sample(JOINTS, self.chance.randint(1, len(JOINTS)))
        velocities = {name: self.chance.uniform(-MOST_RAD_S, MOST_RAD_S) for name in moved}
        share = await self.ask(arm, velocities, self.chance.uniform(0.1, 1.0))
        self.run_for(self.chance.uniform(0.05, 1.0))
        return [share]

    async def jog_hand(self, arm: Arm) -> list[float]:
        x, y = (self.chance.uniform(-MOST_M_S, MOST_M_S) for _ in "xy")
        shares = []
        for _ in range(SAMPLES):
            shares.append(await self.ask(arm, arm.of_hand(x, y), SILENCE_S))
            self.run_for(SAMPLE_S)
        return shares

    def run_for(self, seconds: float) -> None:
        for _ in range(round(seconds / TICK_S)):
            for arm in self.arms:
                arm.tick()
            one, other = (arm.shapes for arm in self.arms)
            assert not self._touch(one, other), "the arms touch"
            assert not self._touch([*one, *other], self.crates), "an arm touches a crate"
            assert not any(arm.folded for arm in self.arms), "an arm touches itself"


@pytest.fixture(autouse=True)
def _patience(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(nearby, "EARLY_S", 60.0)
    monkeypatch.setattr(checks, "_TIMEOUT_S", 60.0)


@pytest.mark.parametrize("seed", SEEDS)
async def test_random_jogs_touch_nothing(tmp_path: Path, seed: int) -> None:
    """2,000 in the long tests, half of them of a hand by a stream."""
    chance = random.Random(seed)
    cell, shares = Cell(tmp_path, chance), list[float]()
    async with cell.checks:
        for number in range(JOGS):
            if number % JOGS_IN_ONE_WORLD == 0:
                cell.scatter()
            shares += await chance.choice((cell.jog_joints, cell.jog_hand))(chance.choice(cell.arms))
    assert shares.count(1.0) > len(shares) / 4
    assert any(0.0 < share < 1.0 for share in shares)
