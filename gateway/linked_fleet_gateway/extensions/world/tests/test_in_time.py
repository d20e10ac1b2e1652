"""Two arms that share space: they pass each other when their times allow, and stop when these are not kept.

The positions of the other arm are those of the agent's own code. The check runs in its process.
"""

import asyncio
import math
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Self

import pytest

from linked_fleet_agent.plan import Plan, Start, plan
from linked_fleet_agent.robot import JointFacts
from linked_fleet_agent.urdf.limits import Limits
from linked_fleet_agent.wire.codec import encode_state, layout
from linked_fleet_agent.wire.messages import Description, Follow, Mesh, Move, State
from linked_fleet_gateway.actions.plan import Motion, RobotTime
from linked_fleet_gateway.app.application import create_live
from linked_fleet_gateway.app.settings import GatewaySettings
from linked_fleet_gateway.extensions.models.meshes import Meshes
from linked_fleet_gateway.extensions.world import checks, nearby
from linked_fleet_gateway.extensions.world.checks import Checks
from linked_fleet_gateway.extensions.world.collisions import Collides
from linked_fleet_gateway.extensions.world.course import course_of
from linked_fleet_gateway.extensions.world.motion_watch import OFF_TIME, MotionWatch
from linked_fleet_gateway.extensions.world.placement import PLACEMENT, encode_placement
from linked_fleet_gateway.extensions.world.questions import legs_through, paths_of
from linked_fleet_gateway.extensions.world.schedules import BEHIND_S, EARLY_S, FRESH_S, LATE_S, START_S, Run
from linked_fleet_identity.rights import ALL, View
from linked_fleet_state.events import Appeared, Described, Framed, Vanished
from linked_fleet_state.invocation import Invocation, InvocationState
from linked_fleet_state.jogging import JointDrive
from linked_fleet_state.model import Pose
from linked_fleet_state.robot import Robot
from linked_fleet_state.unchecked import Finding
from virtual.zenoh_network import ZenohNetwork

URDF = """<robot name="arm"><link name="foot"/>
<link name="rod"><collision><origin xyz="0.5 0 0"/><geometry><box size="1 0.04 0.04"/></geometry></collision></link>
<joint name="turn" type="revolute"><parent link="foot"/><child link="rod"/><axis xyz="0 0 1"/>
<limit lower="-3" upper="3" velocity="1" effort="10"/></joint></robot>"""
TURN = JointFacts("turn", limits=Limits(-3.0, 3.0, 1.0, 10.0))
LEFT, RIGHT = Pose((0.0, 0.0, 0.5), (0.0, 0.0, 0.0, 1.0)), Pose((1.5, 0.0, 0.5), (0.0, 0.0, 1.0, 0.0))
"""Their rods are 1 m long, and point at each other at 0. Each is in reach of the other within 41.4° of that."""
BEGAN_NS = 10_000_000_000


@dataclass
class Arm:
    """What the agent of an arm says: its motion began at ``began_s`` and is ``behind_s`` behind the agent's plan."""

    robot: Robot
    stands: float = 0.0
    planned: Plan | None = None
    began_s: float = 0.0
    behind_s: float = 0.0
    sequence: int = 0

    def at(self, now_s: float) -> float:
        if self.planned is None:
            return self.stands
        return self.planned.trajectories["turn"].at(max(0.0, now_s - self.began_s - self.behind_s))[0]


@dataclass
class Cell:
    """Two arms, their gateway, and a clock that only the test advances."""

    folder: Path
    now_s: float = 0.0
    arms: dict[str, Arm] = field(default_factory=dict)
    ended: dict[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.live = create_live(GatewaySettings(), ZenohNetwork().gateway("g"))
        self.checks = Checks(self.live, Meshes(self._ask), {}, self.folder)
        self.checks.schedules._now_ns = lambda: self.now_ns
        self.watch = MotionWatch(self.checks, self.live.fleet.robots, self.live.invocations.get, self._cancel)

    @property
    def now_ns(self) -> int:
        return BEGAN_NS + round(self.now_s * 1e9)

    async def _ask(self, robot: str, mesh: Mesh, timeout_s: float) -> bytes:
        raise AssertionError("they have no meshes")

    async def _cancel(self, id: str, reason: str) -> bool:
        self.ended[id] = reason
        self.end(id, InvocationState.CANCELLED)
        return True

    def add(self, name: str, base: Pose, degrees: float) -> None:
        described = Description(
            version=1, robot=name, incarnation=1, title=name, urdf=URDF, joints=("turn",), rate_hz=100,
            capabilities=("move",), layout=layout(1, False),
        )  # fmt: skip
        for event in (Appeared(name, 1), Described(described)):
            self.live.fleet.apply(event, self.now_ns)
        robot = self.live.fleet.robots[name]
        robot.settings = {PLACEMENT: encode_placement(base, accepts_unchecked=False)}
        self.arms[name] = Arm(robot, math.radians(degrees))
        self.tell(name)

    def tell(self, name: str) -> None:
        """Send the present frame of an arm."""
        arm = self.arms[name]
        arm.sequence += 1
        moves = arm.planned is not None and 0.0 < self.now_s - arm.began_s < arm.planned.duration_s
        frame = State(
            incarnation=1, sequence=arm.sequence, monotonic_ns=self.now_ns, wall_ns=self.now_ns,
            positions=(arm.at(self.now_s),), velocities=(0.5 if moves else 0.0,), efforts=(0.0,),
        )  # fmt: skip
        self.live.fleet.apply(Framed(name, encode_state(frame)), self.now_ns)

    def wait_until(self, now_s: float) -> None:
        self.now_s = now_s
        for name in self.arms:
            self.tell(name)

    async def go(
        self, name: str, degrees: float, scale: float = 1.0, via: Follow | None = None, sees: View = ALL
    ) -> Finding:
        """Check a motion as the gateway does, and begin it. Raises Collides."""
        arm, id, target = self.arms[name], f"{name}-{self.now_s}", math.radians(degrees)
        moved, stands = via or Move({"turn": target}), arm.at(self.now_s)
        motion = Motion(arm.robot, moved, {"turn": target}, RobotTime(1, self.now_ns), scale)
        run = Invocation(id, name, f"/{name}/turn/actions/rotate", {"turn": target}, self.now_ns, 2**62, incarnation=1)
        self.live.invocations.add(run)
        await self.checks.wait_until_ready(arm.robot, ALL)
        try:
            found = await self.checks.check_path(motion, sees, id)
        except Collides:
            self.end(id, InvocationState.FAILED)
            raise
        arm.planned, arm.began_s = plan(moved, scale, [Start(TURN, stands)]), self.now_s
        run.duration_s, run.started_ns, run.state = arm.planned.duration_s, self.now_ns, InvocationState.RUNNING
        return found

    def grip(self, name: str) -> None:
        """Begin another motion of an arm, a moment ago, by an action of a component."""
        began_ns = self.now_ns - 1_000_000_000
        run = Invocation(f"{name}-grip", name, f"/{name}/gripper/actions/grasp", {}, began_ns, 2**62, incarnation=1)
        run.moves = ("finger",)
        self.live.invocations.add(run)

    def end(self, id: str, state: InvocationState) -> None:
        run = self.live.invocations.get(id)
        assert run is not None
        run.state = state
        self.stop(run.robot)

    def stop(self, name: str) -> None:
        arm = self.arms[name]
        arm.stands, arm.planned = arm.at(self.now_s), None

    async def look(self) -> dict[str, str]:
        """Let the watch look, and return the reasons for which it has ended motions so far."""
        await self.watch.look()
        await asyncio.gather(*self.watch._ending.values())
        return self.ended

    async def __aenter__(self) -> Self:
        await self.checks.__aenter__()
        return self

    async def __aexit__(self, *_: object) -> None:
        await self.checks.__aexit__(None, None, None)


@pytest.fixture(autouse=True)
def _patience(monkeypatch: pytest.MonkeyPatch) -> None:
    """A busy machine takes longer than the limits to start the process."""
    monkeypatch.setattr(nearby, "EARLY_S", 30.0)
    monkeypatch.setattr(checks, "_TIMEOUT_S", 30.0)


@asynccontextmanager
async def cell_in(folder: Path, left: float, right: float) -> AsyncIterator[Cell]:
    async with Cell(folder) as cell:
        cell.add("left", LEFT, left)
        cell.add("right", RIGHT, right)
        yield cell


async def _passing_after(cell: Cell) -> Finding:
    """Let the right arm cross the middle, and the left one come slowly, 3.6 s later."""
    await cell.go("right", -60)
    cell.wait_until(1.3)
    return await cell.go("left", -60, 0.5)


async def _passing_before(cell: Cell) -> Finding:
    """Let the right arm come slowly, and the left one leave the middle before."""
    await cell.go("right", -60, 0.5)
    cell.wait_until(0.1)
    return await cell.go("left", -70)


async def test_an_arm_comes_after_the_other_has_passed(tmp_path: Path) -> None:
    async with cell_in(tmp_path, 120, 60) as cell:
        found = await _passing_after(cell)
        assert found.free and len(cell.checks.pairs) == 1
        assert found.until_ns == cell.now_ns + START_S * 1e9
        assert not await cell.look()


async def test_an_arm_passes_before_the_other_comes(tmp_path: Path) -> None:
    async with cell_in(tmp_path, 60, 150) as cell:
        assert (await _passing_before(cell)).free
        assert len(cell.checks.pairs) == 1


async def test_an_arm_that_would_pass_shortly_before_the_other_comes_is_refused(tmp_path: Path) -> None:
    async with cell_in(tmp_path, 60, 150) as cell:
        await cell.go("right", -60, 0.8)
        cell.wait_until(0.1)
        with pytest.raises(Collides):  # the right one comes 0.7 s after the left one has left
            await cell.go("left", -70)


async def test_an_arm_with_another_motion_of_its_own_keeps_no_times(tmp_path: Path) -> None:
    async with cell_in(tmp_path, 120, 60) as cell:
        await cell.go("right", -60)
        cell.grip("left")
        cell.wait_until(1.3)
        with pytest.raises(Collides):
            await cell.go("left", -60, 0.5)


async def test_the_rest_of_a_motion_is_judged_in_time(tmp_path: Path) -> None:
    async with cell_in(tmp_path, 120, 60) as cell:
        await _passing_after(cell)
        cell.wait_until(1.6)
        await cell.checks.check_rest(Run("left", "left-1.3"))
        cell.now_s += 0.2
        on_time = cell.checks.on_time(cell.arms["left"].robot)
        assert on_time is not None and on_time.elapsed_s == pytest.approx(0.5)


async def test_an_arm_that_is_a_little_behind_is_met_from_where_it_is(tmp_path: Path) -> None:
    async with cell_in(tmp_path, 120, 60) as cell:
        await cell.go("right", -60)
        arm = cell.arms["right"]
        arm.behind_s = 0.45
        cell.wait_until(1.3)
        on_time = cell.checks.on_time(arm.robot)
        assert on_time is not None
        places, times_s = on_time.met()
        turns = [each["turn"] for each in places]
        assert turns[0] >= arm.at(1.3) and turns[-1] == math.radians(-60)
        assert max(before - after for before, after in pairwise(turns)) < 0.15
        assert all(until_s > later_s for (_, until_s), (later_s, _) in pairwise(times_s))


async def test_nobody_learns_when_an_invisible_robot_arrives(tmp_path: Path) -> None:
    async with cell_in(tmp_path, 60, 60) as cell:
        await cell.go("right", -60)
        cell.wait_until(1.0)
        with pytest.raises(Collides) as refused:
            await cell.go("left", -60, sees=View.of(frozenset({"left"}), "somebody"))
        assert "Retry-After" not in refused.value.headers and "right" not in str(refused.value.detail)


async def test_both_keep_their_times_until_one_has_arrived(tmp_path: Path) -> None:
    async with cell_in(tmp_path, 120, 60) as cell:
        await _passing_after(cell)
        for now_s in (1.5, 2.0, 2.5, 3.0):
            cell.wait_until(now_s)
            assert not await cell.look() and cell.checks.pairs
        cell.wait_until(3.5)
        cell.end("right-0.0", InvocationState.SUCCEEDED)
        assert not await cell.look() and not cell.checks.pairs


@pytest.mark.parametrize(("asked_s", "scale"), [(0.2, 1.0), (1.3, 1.0), (0.2, 0.5)])
async def test_arms_that_would_be_there_at_one_time_meet(tmp_path: Path, asked_s: float, scale: float) -> None:
    async with cell_in(tmp_path, 100, 60) as cell:
        await cell.go("right", -60)
        cell.wait_until(asked_s)
        with pytest.raises(Collides, match="rod of left would meet rod of right"):
            await cell.go("left", -60, scale)
        assert not cell.checks.pairs


async def test_a_refusal_says_when_the_way_will_be_free(tmp_path: Path) -> None:
    async with cell_in(tmp_path, 60, 60) as cell:
        await cell.go("right", -60)
        cell.wait_until(1.0)
        with pytest.raises(Collides) as refused:
            await cell.go("left", -60)
        arrives_s = cell.arms["right"].planned.duration_s - 1.0  # type: ignore[union-attr]
        assert refused.value.headers["Retry-After"] == str(math.ceil(arrives_s + LATE_S))
        assert refused.value.members["retryAfter"] == math.ceil(arrives_s + LATE_S)
        assert "The way will be free in" in refused.value.detail


async def test_a_refusal_says_nothing_if_the_other_arm_ends_in_the_way(tmp_path: Path) -> None:
    async with cell_in(tmp_path, 60, 60) as cell:
        await cell.go("right", 0)
        cell.wait_until(1.0)
        with pytest.raises(Collides) as refused:
            await cell.go("left", -60)
        assert "Retry-After" not in refused.value.headers


async def test_a_motion_that_is_free_of_the_whole_sweep_relies_on_nothing(tmp_path: Path) -> None:
    async with cell_in(tmp_path, 60, 60) as cell:
        await cell.go("right", -60)
        cell.wait_until(1.0)
        found = await cell.go("left", 100)
        assert found.free and found.until_ns == 0 and not cell.checks.pairs


def _slow(cell: Cell) -> None:
    cell.arms["right"].behind_s = BEHIND_S + 0.3


def _stop(cell: Cell) -> None:
    cell.end("right-0.0", InvocationState.CANCELLED)


def _lose(cell: Cell) -> None:
    cell.live.fleet.apply(Vanished("right", 1), cell.now_ns)


def _replace(cell: Cell) -> None:
    cell.end("right-0.0", InvocationState.PREEMPTED)
    run = Invocation("other", "right", "/right/actions/x", {"turn": 1.0}, cell.now_ns, 2**62, incarnation=1)
    cell.live.invocations.add(run)


@pytest.mark.parametrize("happens", [_slow, _stop, _lose, _replace])
async def test_what_comes_after_another_arm_ends_if_that_does_not_keep_its_times(
    tmp_path: Path, happens: Callable[[Cell], None]
) -> None:
    async with cell_in(tmp_path, 120, 60) as cell:
        await _passing_after(cell)
        cell.wait_until(1.6)
        assert not await cell.look()
        happens(cell)
        cell.wait_until(1.7)
        ended = await cell.look()
        assert list(ended) == ["left-1.3"]
        assert ended["left-1.3"].startswith(f"{OFF_TIME}rod would meet another robot")


async def test_frames_that_do_not_come_any_more_confirm_nothing(tmp_path: Path) -> None:
    async with cell_in(tmp_path, 120, 60) as cell:
        await _passing_after(cell)
        cell.now_s += FRESH_S - 0.05
        assert not await cell.look()
        cell.now_s += 0.1
        assert "left-1.3" in await cell.look()


async def test_a_motion_goes_on_if_the_other_arm_stops_where_it_is_not_in_the_way(tmp_path: Path) -> None:
    async with cell_in(tmp_path, 120, 60) as cell:
        await _passing_after(cell)
        cell.wait_until(2.8)
        cell.end("right-0.0", InvocationState.CANCELLED)
        cell.wait_until(2.9)
        assert not await cell.look()


async def test_an_arm_that_stops_on_its_way_before_another_ends_that(tmp_path: Path) -> None:
    async with cell_in(tmp_path, 60, 150) as cell:
        await _passing_before(cell)
        cell.wait_until(0.9)
        cell.end("left-0.1", InvocationState.CANCELLED)
        cell.wait_until(1.0)
        assert list(await cell.look()) == ["right-0.0"]


async def test_a_lost_arm_is_ended_and_does_not_keep_the_other_one_waiting(tmp_path: Path) -> None:
    async with cell_in(tmp_path, 60, 150) as cell:
        await _passing_before(cell)
        cell.wait_until(0.9)
        cell.live.fleet.apply(Vanished("left", 1), cell.now_ns)
        silent = asyncio.Event()

        async def cancel(id: str, reason: str) -> bool:
            cell.ended[id] = reason
            return await silent.wait()

        cell.watch._cancel = cancel
        cell.wait_until(1.0)
        await cell.watch.look()
        await asyncio.sleep(0)
        assert list(cell.ended) == ["left-0.1"]
        await cell.watch.look()
        await asyncio.sleep(0)
        assert list(cell.ended) == ["left-0.1", "right-0.0"]
        silent.set()


async def _unknown_course(cell: Cell) -> None:
    await cell.go("right", -60)
    cell.checks.schedules._begun["right"].clear()


async def _jogged(cell: Cell) -> None:
    await cell.go("right", -60)
    cell.checks._jogs._now_s = lambda: 0.0
    cell.checks._jogs.begin(cell.arms["right"].robot, JointDrive({"turn": -0.1}, 0.5, {"turn": 1.0}))


async def _behind(cell: Cell) -> None:
    await cell.go("right", -60)
    cell.arms["right"].behind_s = BEHIND_S + 0.2


async def _of_other_duration(cell: Cell) -> None:
    await cell.go("right", -60)
    cell.live.invocations.get("right-0.0").duration_s = 4.0  # type: ignore[union-attr]


async def _gripping(cell: Cell) -> None:
    await cell.go("right", -60)
    cell.grip("right")


async def _not_begun(cell: Cell) -> None:
    await cell.go("right", -60)
    cell.live.invocations.get("right-0.0").started_ns = None  # type: ignore[union-attr]


@pytest.mark.parametrize("begin", [_unknown_course, _jogged, _behind, _of_other_duration, _gripping, _not_begun])
async def test_a_motion_of_unknown_times_is_met_everywhere_on_its_way(
    tmp_path: Path, begin: Callable[[Cell], "asyncio.Future[None]"]
) -> None:
    async with cell_in(tmp_path, 120, 60) as cell:
        await begin(cell)
        cell.wait_until(1.3)
        with pytest.raises(Collides) as refused:
            await cell.go("left", -60, 0.5)
        assert "Retry-After" not in refused.value.headers


async def test_an_arm_on_a_trajectory_is_met_where_that_leads(tmp_path: Path) -> None:
    there_and_back = Follow(("turn",), (4.0, 8.0), ((0.0,), (math.radians(100),)))
    async with cell_in(tmp_path, 60, 100) as cell:
        await cell.go("right", 100, via=there_and_back)
        cell.wait_until(0.1)
        cell.live.invocations.get("right-0.0").started_ns = None  # type: ignore[union-attr]
        with pytest.raises(Collides):
            await cell.go("left", -60)


async def test_a_motion_that_does_not_begin_at_rest_is_judged_as_before(tmp_path: Path) -> None:
    async with cell_in(tmp_path, 120, 60) as cell:
        await cell.go("right", -60)
        cell.wait_until(1.3)
        await cell.go("left", 140)
        cell.wait_until(1.5)
        with pytest.raises(Collides):
            await cell.go("left", -60, 0.5)


@pytest.mark.parametrize("scale", [1.0, 0.3])
@pytest.mark.parametrize("degrees", [2.0, 15.0, 170.0])
def test_the_course_of_a_move_is_the_trajectory_of_the_agent(tmp_path: Path, degrees: float, scale: float) -> None:
    cell = Cell(tmp_path)
    cell.add("left", LEFT, 0)
    move, start = Move({"turn": math.radians(degrees)}), {"turn": 0.0}
    [direct] = paths_of(move, start, {})
    course = course_of(cell.arms["left"].robot, move, scale, direct.legs, start)
    agent = plan(move, scale, [Start(TURN, 0.0)])
    assert course is not None and course.duration_s == pytest.approx(agent.duration_s)
    for share in range(41):
        time_s = share / 40 * agent.duration_s
        assert course.at(time_s)["turn"] == pytest.approx(agent.trajectories["turn"].at(time_s)[0], abs=1e-3)


def test_the_course_of_a_trajectory_is_that_of_the_agent(tmp_path: Path) -> None:
    cell = Cell(tmp_path)
    cell.add("left", LEFT, 0)
    follow, start = Follow(("turn",), (1.0, 2.5, 3.0), ((0.4,), (0.2,), (0.3,))), {"turn": 0.0}
    legs = legs_through(follow.joints, follow.times_s, follow.positions, start)
    course = course_of(cell.arms["left"].robot, follow, 1.0, legs, start)
    agent = plan(follow, 1.0, [Start(TURN, 0.0)])
    assert course is not None
    for share in range(61):
        assert course.at(share / 20)["turn"] == pytest.approx(agent.trajectories["turn"].at(share / 20)[0], abs=1e-9)


def test_the_windows_leave_time_to_see_check_and_stop() -> None:
    assert LATE_S >= BEHIND_S + 1.0 and EARLY_S >= START_S + BEHIND_S + 1.0
