"""The simulated Go2 walks under its agent: straight, upright, and back to the stand that it began with."""

import math
import random

import msgspec
import pytest

from linked_fleet_agent.components.declaration import declare
from linked_fleet_agent.components.driving import VelocityBase
from linked_fleet_agent.robots.catalogue import MODELS
from linked_fleet_agent.robots.trot import Foot
from linked_fleet_agent.robots.walking_base import WalkingBase
from linked_fleet_agent.wire.messages import Accepted, Refused
from simulated_bench import Simulated

PART = MODELS["go2"].parts.legs
assert PART is not None
LIMITS, LEGS = PART.limits, PART.legs
MOST_LEAN_RAD = 0.3


class Go2(Simulated):
    """The robot; the most by which it leant is kept."""

    def __init__(self) -> None:
        super().__init__("go2")
        assert isinstance(self.mujoco.base, WalkingBase)
        self.base, self.lean_rad = self.mujoco.base, 0.0
        [self.component] = [each for each in self.mujoco.components() if isinstance(each, VelocityBase)]

    async def tick(self, seconds: float = 0.01) -> None:
        for _ in range(max(1, round(seconds / 0.01))):
            await super().tick()
            base = self.link.states[-1].base
            assert base is not None
            x, y = base.orientation_xyzw[:2]
            self.lean_rad = max(self.lean_rad, 2.0 * math.asin(min(math.hypot(x, y), 1.0)))

    def drive(self, id: str = "d", **given: float) -> None:
        reply = self.operate(id, "drive", given, component="mobile_base")
        assert isinstance(reply, Accepted), reply

    async def drive_on(self, seconds: float, **given: float) -> None:
        for number in range(round(2 * seconds)):
            self.drive(f"on{number}-{self.now_ns}", **given, duration=0.6)
            await self.tick(0.5)
        await self.tick(2)

    @property
    def legs(self) -> dict[str, float]:
        names = [joint.name for joint in self.mujoco.describe().joints]
        return dict(zip(names, self.link.states[-1].positions, strict=True))

    async def crouch(self) -> None:
        assert isinstance(self.move("c", **MODELS["go2"].poses["crouched"]), Accepted)
        await self.until(lambda: self.states("c")[-1:] == ["succeeded"])


@pytest.mark.parametrize("leg", LEGS, ids=lambda leg: leg.name)
def test_the_joints_of_a_leg_bring_its_foot_where_it_is_wanted(leg: object) -> None:
    draw = random.Random(3)
    for _ in range(200):
        hip, thigh, calf = draw.uniform(-0.6, 0.6), draw.uniform(-0.5, 1.5), draw.uniform(-2.4, -0.9)
        assert leg.joints(leg.foot(hip, thigh, calf)) == pytest.approx((hip, thigh, calf), abs=1e-6)  # type: ignore[attr-defined]


def test_a_foot_out_of_reach_is_approached() -> None:
    joints = LEGS[0].joints(Foot(0.5, 0.1, -0.9))
    assert all(map(math.isfinite, joints))
    assert LEGS[0].foot(*joints).z < -0.2


@pytest.mark.parametrize(
    ("given", "way"),
    [
        ({"linear": 0.4}, (2.0, 0.0, 0.0)),
        ({"linear": -0.3}, (-1.5, 0.0, 0.0)),
        ({"lateral": 0.2}, (0.0, 1.0, 0.0)),
        ({"angular": 0.6}, (0.0, 0.0, 3.0)),
    ],
    ids=str,
)
@pytest.mark.parametrize("stand", ["home", "crouched"])
async def test_it_walks_straight_and_returns_to_its_stand(
    given: dict[str, float], way: tuple[float, float, float], stand: str
) -> None:
    go2 = Go2()
    if stand == "crouched":
        await go2.crouch()
    before = go2.legs
    await go2.drive_on(5, **given)
    x, y, heading = go2.base.pose
    length = math.hypot(way[0], way[1])
    assert (x, y) == pytest.approx(way[:2], abs=0.1 * length + 0.07)
    assert math.remainder(heading - way[2], math.tau) == pytest.approx(0.0, abs=0.1 * abs(way[2]) + 0.05)
    assert go2.lean_rad < MOST_LEAN_RAD
    assert go2.legs == pytest.approx(before, abs=2e-3)
    at = go2.base.pose
    await go2.tick(1)
    assert go2.base.pose == pytest.approx(at, abs=2e-3)


async def test_it_stops_within_its_stop_time_with_all_feet_on_the_ground() -> None:
    go2 = Go2()
    go2.drive(linear=0.4, angular=0.5, duration=1.0)
    await go2.tick(0.8)
    assert isinstance(go2.stop("s"), Accepted)
    await go2.tick(0.1)
    assert go2.states("d")[-1] == "running"
    await go2.tick(declare(go2.component).said.actions["drive"].stop_s)
    assert go2.states("d")[-1] == "cancelled"
    await go2.tick(0.5)
    assert go2.states("s")[-1] == "succeeded"
    assert not go2.base.walking


async def test_walking_and_motions_of_legs_end_each_other() -> None:
    go2 = Go2()
    go2.drive(linear=0.3, duration=1.0)
    await go2.tick(0.5)
    await go2.crouch()
    assert go2.states("d")[-1] == "preempted"
    assert go2.legs == pytest.approx(MODELS["go2"].poses["crouched"], abs=2e-3)
    assert isinstance(go2.move("h", **MODELS["go2"].home), Accepted)
    await go2.tick(0.3)
    go2.drive("e", linear=0.2, duration=1.0)
    await go2.tick(4)
    assert (go2.states("h")[-1], go2.states("e")[-1]) == ("preempted", "succeeded")
    assert go2.lean_rad < MOST_LEAN_RAD


@pytest.mark.parametrize("stand", ["home", "crouched"])
async def test_it_does_not_fall_in_a_minute_of_random_velocities(stand: str) -> None:
    go2, draw = Go2(), random.Random(11)
    if stand == "crouched":
        await go2.crouch()
    for number in range(80):
        given = {
            "linear": draw.choice([-1, 0, 1, draw.uniform(-1, 1)]) * LIMITS.linear,
            "lateral": draw.choice([-1, 0, 1, draw.uniform(-1, 1)]) * LIMITS.lateral,
            "angular": draw.choice([-1, 0, 1, draw.uniform(-1, 1)]) * LIMITS.angular,
        }
        go2.drive(f"r{number}", **given, duration=draw.choice([0.2, 0.8, 1.0]))
        await go2.tick(draw.uniform(0.3, 1.2))
    await go2.tick(2)
    assert go2.lean_rad < MOST_LEAN_RAD
    assert not go2.base.fallen
    assert go2.shown("diagnostics")["status"][0]["level"] == "ok"


async def test_it_follows_a_path_with_its_headings() -> None:
    go2 = Go2()
    path = [{"x": 0.8, "y": 0.0, "heading": 0.0}, {"x": 1.0, "y": 0.6, "heading": 1.0}]
    assert isinstance(go2.operate("f", "followPath", {"path": path}, component="mobile_base"), Accepted)
    await go2.tick(12)
    assert go2.states("f")[-1] == "succeeded"
    assert go2.base.pose == pytest.approx((1.0, 0.6, 1.0), abs=0.05)
    assert msgspec.json.decode(go2.end("f").result)["error"] < 0.05


async def test_its_frames_and_its_pose_drift_alike_with_its_odometry() -> None:
    go2 = Go2()
    await go2.set("simulation", "odometryDrift", 0.2)
    await go2.drive_on(3, linear=0.3, angular=0.3)
    shown, true, frame = go2.shown("mobile_base")["pose"], go2.shown("simulation")["truePose"], go2.link.states[-1].base
    assert frame is not None
    assert shown["heading"] == pytest.approx(1.2 * true["heading"], abs=0.02)
    assert frame.position_m[:2] == pytest.approx((shown["x"], shown["y"]), abs=0.01)
    heading = 2.0 * math.atan2(frame.orientation_xyzw[2], frame.orientation_xyzw[3])
    assert heading == pytest.approx(shown["heading"], abs=0.02)
    assert frame.position_m[2] == pytest.approx(0.335, abs=0.01)


async def test_a_fallen_robot_does_not_walk_and_says_so() -> None:
    go2 = Go2()
    go2.mujoco._data.qpos[2:7] = (0.2, math.cos(0.8), math.sin(0.8), 0.0, 0.0)
    go2.drive(linear=0.3)
    await go2.tick(2)
    assert not go2.base.walking
    assert {"name": "legs", "level": "error", "message": "the robot has fallen, and does not walk"} in go2.shown(
        "diagnostics"
    )["status"]


async def test_it_is_refused_what_is_faster_than_its_legs() -> None:
    assert isinstance(Go2().operate("d", "drive", {"linear": 0.6}, component="mobile_base"), Refused)
