"""Robots simulated inside the test, with the product's agents and drivers; the test sees every step of MuJoCo.

They run on their own clock, one tick after another, so that the load of the machine does not change what they do. In
real time they run in a thread, on virtual time in the loop of the test at the pace of its clock.
"""

import asyncio
import contextlib
import math
import threading
from collections.abc import Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import NamedTuple

import mujoco
import numpy as np
import numpy.typing as npt

from linked_fleet_agent.agent import Agent
from linked_fleet_agent.robots.catalogue import MODELS, load, poses_of
from linked_fleet_agent.robots.mujoco_robot import MujocoRobot
from linked_fleet_agent.serving import link_of
from linked_fleet_agent.transport import Session
from linked_fleet_agent.wire.keys import Keys
from linked_fleet_agent.zenoh_session import open_session
from virtual.loop import VirtualLoop, current

Array = npt.NDArray[np.float64]

TICK_S = 0.01
# Below 0.01 rad/s the agent considers a motor at rest; what the joint carries may still swing a little.
RESTING_RAD_S = 0.02
_PAUSE_S = 0.004  # between ticks; less than TICK_S, so that robots run faster than real time
_ROOT = 1  # the body of the root link
SIMULATED = "simulated"
TURNTABLE = Path(__file__).with_name("turntable.urdf")
"""A robot whose one joint turns endlessly."""


class Step(NamedTuple):
    """The state of MuJoCo before one of its steps, in the order of the joints: rad, rad/s, N m or m, m/s, N."""

    time_s: float
    positions: Array
    velocities: Array
    efforts: Array


class SimulatedRobot:
    """A robot of the catalogue or the turntable, with its agent. ``steps``: those since ``watch``."""

    def __init__(self, name: str) -> None:
        robot = load(name, str(TURNTABLE) if name == TURNTABLE.stem else name)
        assert isinstance(robot, MujocoRobot)
        facts = robot.describe()
        self.name, self.base = name, robot.base
        self.joints = {joint.name: joint for joint in facts.joints}
        self.linear = {joint.name for joint in facts.joints if joint.linear}
        self.poses = poses_of(MODELS[name], facts.joints) if name in MODELS else {}
        # The simulator's state, which otherwise only the driver has.
        self.model, self.data = robot._model, robot._data
        self._qpos, self._dof, self._setpoints = robot._qpos, robot._dof, robot._setpoints
        self._scratch = mujoco.MjData(self.model)
        self._now_ns = 1_000_000_000
        self._agent = Agent(name, robot, monotonic_ns=lambda: self._now_ns)
        self._lock = threading.Lock()
        self.steps: list[Step] = []
        self.accepted_s = math.nan

    async def run(self, session: Session, end: asyncio.Event, pause_s: float = _PAUSE_S) -> None:
        agent = self._agent
        async with link_of(agent, session, Keys(), on_command=self._command) as link:
            while not end.is_set():
                with self._lock:
                    self._now_ns += round(TICK_S * 1e9)
                    agent.tick(link)
                await asyncio.sleep(pause_s)

    def _command(self, payload: bytes) -> bytes:
        self.accepted_s = self.data.time
        return self._agent.handle(payload)

    def note(self) -> None:
        """Record a step; called by MuJoCo in each step."""
        data = self.data
        self.steps.append(Step(data.time, data.qpos[self._qpos], data.qvel[self._dof], data.qfrc_actuator[self._dof]))

    # -- what the test sees -----------------------------------------------------------------------------------------

    def watch(self) -> None:
        """Forget the steps so far."""
        with self._lock:
            self.steps.clear()

    def seen(self, joint: str, of: str = "positions") -> tuple[Array, Array]:
        """Return times (s of the simulation) and values of one joint in each step since ``watch``."""
        column = list(self.joints).index(joint)
        with self._lock:
            steps = list(self.steps)
        return np.array([step.time_s for step in steps]), np.array([getattr(step, of)[column] for step in steps])

    def positions(self) -> dict[str, float]:
        with self._lock:
            return dict(zip(self.joints, self.data.qpos[self._qpos].tolist(), strict=True))

    def speed(self) -> float:
        """Return the speed of the fastest commanded joint, in rad/s or m/s."""
        with self._lock:
            speeds = dict(zip(self.joints, np.abs(self.data.qvel[self._dof]).tolist(), strict=True))
        return max(speed for name, speed in speeds.items() if self.joints[name].mimics is None)

    def setpoints(self) -> list[float]:
        """Return the setpoints of the servos, which unlike measurements do not fluctuate at all."""
        with self._lock:
            return self._setpoints.tolist()

    def pose(self, link: str, joints: Mapping[str, float] | None = None) -> tuple[Array, Array]:
        """Return position (m) and orientation (x y z w) of a link relative to the root link.

        ``joints``: assumed positions; the other joints are where they are.
        """
        with self._lock:
            self._scratch.qpos[:] = self.data.qpos
        for name, position in (joints or {}).items():
            self._scratch.qpos[self.model.joint(name).qposadr[0]] = position
        mujoco.mj_kinematics(self.model, self._scratch)
        body = self._scratch.body(link)
        back, position, turned = np.zeros(4), np.zeros(3), np.zeros(4)
        mujoco.mju_negQuat(back, self._scratch.xquat[_ROOT])
        mujoco.mju_rotVecQuat(position, body.xpos - self._scratch.xpos[_ROOT], back)
        mujoco.mju_mulQuat(turned, back, body.xquat)
        return position, np.roll(turned, -1)

    def upright(self) -> float:
        """Return the cosine of the angle by which the root link leans; 1 is upright."""
        with self._lock:
            return float(self.data.body(_ROOT).xmat[8])

    def check_limits(self) -> None:
        """Check that no joint exceeded the speed or effort limits of its URDF in any step since ``watch``.

        A joint that mimics another has no motor: its speed follows from the other joint.
        """
        with self._lock:
            steps = list(self.steps)
        assert steps, "nothing was seen"
        speeds, efforts = (np.abs([getattr(s, of) for s in steps]).max(axis=0) for of in ("velocities", "efforts"))
        for (name, joint), speed, effort in zip(self.joints.items(), speeds, efforts, strict=True):
            if joint.mimics is None and joint.limits.velocity is not None:
                assert speed <= joint.limits.velocity, f"{name} at {speed} of {joint.limits.velocity}"
            if joint.limits.effort is not None:
                assert effort <= joint.limits.effort * (1 + 1e-9), f"{name} at {effort} of {joint.limits.effort}"


def angle_between(one: Array, other: Array) -> float:
    """Return the angle between two orientations (x y z w) in rad."""
    product, back = np.zeros(4), np.zeros(4)
    mujoco.mju_negQuat(back, np.roll(one, 1))
    mujoco.mju_mulQuat(product, back, np.roll(other, 1))
    return 2.0 * math.atan2(float(np.linalg.norm(product[1:])), abs(float(product[0])))


@contextlib.contextmanager
def simulated(endpoint: str, *names: str) -> Iterator[dict[str, SimulatedRobot]]:
    """Run robots in this process, linked to the gateway that listens at ``endpoint``."""
    robots = {name: SimulatedRobot(name) for name in names}

    def note(_model: mujoco.MjModel, data: mujoco.MjData) -> None:
        for robot in robots.values():
            if robot.data is data:
                robot.note()

    loop = current()
    mujoco.set_mjcb_control(note)
    try:
        with _in_thread(endpoint, robots) if loop is None else _in_loop(loop, endpoint, robots):
            yield robots
    finally:
        mujoco.set_mjcb_control(None)


@contextlib.contextmanager
def _in_thread(endpoint: str, robots: Mapping[str, SimulatedRobot]) -> Iterator[None]:
    loop, end = asyncio.new_event_loop(), asyncio.Event()

    async def run_all() -> None:
        async with open_session((endpoint,)) as session, asyncio.TaskGroup() as group:
            for robot in robots.values():
                group.create_task(robot.run(session, end))

    with ThreadPoolExecutor(1) as thread, contextlib.closing(loop):
        running = thread.submit(loop.run_until_complete, run_all())
        try:
            yield
        finally:
            loop.call_soon_threadsafe(end.set)
            running.result()


@contextlib.contextmanager
def _in_loop(loop: VirtualLoop, endpoint: str, robots: Mapping[str, SimulatedRobot]) -> Iterator[None]:
    """The robots' node in the network is named ``SIMULATED``."""
    from virtual.processes import world  # it imports the product, which few tests need

    session, end = loop.inside(world(loop).network((endpoint,)).agent, SIMULATED), asyncio.Event()

    async def run_all() -> None:
        async with asyncio.TaskGroup() as group:
            for robot in robots.values():
                group.create_task(robot.run(session, end, TICK_S))

    running = loop.create_task(run_all())
    try:
        yield
    finally:
        end.set()
        loop.run_until(running.done, "the end of the robots")
        loop.inside(session.end)
        running.result()
