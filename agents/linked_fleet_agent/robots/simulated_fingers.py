"""Grippers of simulated robots: two fingers in MuJoCo that one motor moves, and what is between them."""

import asyncio
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from typing import Annotated

import mujoco
from msgspec import Meta

from linked_fleet_agent.components import Call, Force, Grasped, Gripper, Holding, Width, action, value
from linked_fleet_agent.components.ticks import Ticks
from linked_fleet_agent.robot import Limits
from linked_fleet_agent.robots.parts import FingersPart
from linked_fleet_agent.robots.servo import Servo

LEAST_FORCE_N, USUAL_FORCE_N = 5.0, 20.0
"""With less force than the least the fingers would hardly move."""
_REACHED_M, _STILL_M_S, _STALLED_S = 2e-4, 1e-3, 0.05
_PUSHING, _LOST = 0.9, 0.5
"""Shares of the force: one that shows a stall, and one below which what was held is lost."""
_STAY_M = 5e-4
"""A setpoint this near leaves a grip as it is."""
_HARD = 0.99
"""Impedance of what is between the fingers, which gives way by some hundredths of a millimetre."""


class Fingers:
    """Two fingers and what is between them. They close towards the lower limit of the first joint, which has the motor.

    ``on_lost`` is called when what they held is not there any more. Times are those of the simulation.
    """

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData, part: FingersPart, servo: Servo, limits: Limits):
        self._data, self._servo = data, servo
        self._addresses = [int(model.joint(name).qposadr[0]) for name in part.joints]
        joint = model.joint(part.joints[0]).id
        self._range, self._closed = model.jnt_range[joint], float(model.jnt_range[joint][0])
        model.jnt_solimp[joint][:2] = _HARD
        model.jnt_solref[joint][0] = 2.0 * model.opt.timestep
        self.opening_m, self.effort_n = len(part.joints) * (limits.upper or 0.0), limits.effort or LEAST_FORCE_N
        self.on_lost: Callable[[], None] = lambda: None
        self._push_n = self._grip_n = self._stalled_s = 0.0
        self._ticks = Ticks()

    @property
    def width(self) -> float:
        """The distance of the fingers in metres."""
        return sum(abs(float(self._data.qpos[each])) for each in self._addresses)

    @property
    def force(self) -> float:
        """The measured force of the motor in newtons."""
        return abs(self._servo.effort)

    @property
    def holding(self) -> bool:
        return self._grip_n > 0.0

    @property
    def moving(self) -> bool:
        return abs(self._servo.velocity) > _STILL_M_S

    @property
    def stalled(self) -> bool:
        """Return True if the fingers stand although the motor pushes."""
        return self._stalled_s >= _STALLED_S

    def drive(self, width_m: float, force_n: float) -> None:
        """Move to a distance, with this much force at most."""
        self._push_n, self._grip_n, self._stalled_s = force_n, 0.0, 0.0
        self._servo.drive(width_m / len(self._addresses), force_n)

    def grip(self) -> None:
        """Push on with the force of ``drive`` where the fingers stand."""
        self._grip_n = self._push_n
        self._servo.push(-self._grip_n)

    def hold(self) -> None:
        """Stay here without force."""
        self._push_n = self._grip_n = 0.0
        self._servo.drive(self._servo.position)

    def yields_to(self, setpoint: float) -> bool:
        """Return True if a setpoint of the agent moves the fingers, which then end their grip.

        One where they stand does not: what a stop holds is not dropped.
        """
        if self.holding and abs(setpoint - self._servo.position) <= _STAY_M:
            return False
        self.hold()
        return True

    def step(self, elapsed_s: float) -> None:
        """Take note that the simulation has advanced."""
        if not (self._push_n or self._ticks.awaited):  # almost always
            return
        pushing = self._push_n > 0.0 and self.force >= _PUSHING * self._push_n
        self._stalled_s = self._stalled_s + elapsed_s if pushing and not self.moving else 0.0
        if self.holding and self.force < _LOST * self._grip_n:
            self.hold()
            self.on_lost()
        self._ticks.happen()

    async def stepped(self) -> None:
        """Wait until the simulation has advanced."""
        await self._ticks.next()

    def put(self, width_m: float) -> None:
        """Put something of this width between the fingers. Raises ValueError if it does not fit."""
        if not 0.0 < width_m <= self.width:
            raise ValueError(f"the fingers are {self.width:.4g} m apart, and {width_m:g} m must fit between them")
        self._range[0] = self._closed + width_m / len(self._addresses)

    def take(self) -> None:
        """Take away what is between the fingers."""
        self._range[0] = self._closed


def gripper_of(part: FingersPart, fingers: Fingers) -> Gripper:
    """Return the component of a gripper, with the ranges of its fingers."""
    gap = Annotated[Width, Meta(le=fingers.opening_m)]
    push = Annotated[Force, Meta(ge=LEAST_FORCE_N, le=fingers.effort_n)]
    usual_n = min(USUAL_FORCE_N, fingers.effort_n)

    class SimulatedGripper(Gripper, blocking=False):
        """A gripper with two fingers that one motor moves."""

        name, title, link = part.name, part.title, part.link

        @value
        def width(self) -> Width:
            return round(fingers.width, 5)

        @value
        def force(self) -> Force:
            """As its motor measures it."""
            return round(fingers.force, 2)

        @value
        def holding(self) -> Holding:
            return fingers.holding

        @action(moves=part.joints[:1], duration_s=20, stop_s=0.5)
        async def grasp(self, call: Call[Width], width: gap = 0.0, force: push = usual_n) -> Grasped:
            """Close the fingers to a width, or until they hold something. A stop leaves them where they are."""
            await _drive(fingers, call, width, force)
            if fingers.stalled:
                fingers.grip()
            return Grasped(fingers.width, fingers.holding, fingers.force)

        @action(moves=part.joints[:1], duration_s=20, stop_s=0.5)
        async def open(self, call: Call[Width], width: gap = fingers.opening_m) -> None:
            """Open the fingers to a width, and so put down what they hold. A stop leaves them where they are."""
            await _drive(fingers, call, width, fingers.effort_n)
            fingers.hold()

    gripper = SimulatedGripper()
    fingers.on_lost = gripper.lost
    return gripper


async def _drive(fingers: Fingers, call: Call[float], width_m: float, force_n: float) -> None:
    """Move the fingers to a distance, or until they stall."""
    async with _stopping(fingers):
        fingers.drive(width_m, force_n)
        while fingers.moving or not (fingers.stalled or abs(fingers.width - width_m) <= _REACHED_M):
            await fingers.stepped()
            call.feedback(fingers.width)


@asynccontextmanager
async def _stopping(fingers: Fingers) -> AsyncIterator[None]:
    """Hold the fingers when the action is cancelled, which ends when they stand."""
    try:
        yield
    except asyncio.CancelledError:
        fingers.hold()
        while fingers.moving:
            await fingers.stepped()
        raise
