"""Bases of simulated robots that roll over the floor with wheels that turn, and the component of simulated bases."""

import math
from collections.abc import Callable

import mujoco
from msgspec.structs import replace

from linked_fleet_agent.components.docking import pose_of, station_at
from linked_fleet_agent.components.driving import VelocityBase
from linked_fleet_agent.components.kinds import Station
from linked_fleet_agent.planar import STANDING, Pose, Velocity
from linked_fleet_agent.robots.mujoco_model import PLANE
from linked_fleet_agent.robots.odometry import Odometry
from linked_fleet_agent.robots.parts import BasePart, LegsPart
from linked_fleet_agent.robots.walking_base import WalkingBase
from linked_fleet_agent.wire.components import BASE

SIGHT_M = 2.0
"""From so far a base sees a charging station."""
CONTACT_M, CONTACT_RAD = 0.015, math.radians(1.5)
"""The most that a base may be off the pose in which a station charges it."""


class RollingBase:
    """The base of a simulated robot. Motors give it each velocity at once: its limits are those of its component.

    ``first_servo`` is the first of the servos of the plane, which those of the wheels follow.
    """

    about = "A base that rolls over the floor of the simulation."
    walking, settles_s = False, 0.0

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData, part: BasePart, first_servo: int) -> None:
        self._data, self._part = data, part
        joints = [model.joint(name) for name in PLANE]
        self._qpos = [int(joint.qposadr[0]) for joint in joints]
        self._dof = [int(joint.dofadr[0]) for joint in joints]
        self._servos = slice(first_servo, first_servo + len(PLANE))
        self._wheel_servos = slice(first_servo + len(PLANE), first_servo + len(PLANE) + len(part.wheels))
        self._wanted = STANDING
        self.odometer = Odometry(self.pose)
        self._seen = {each.name: each for each in part.stations}

    @property
    def pose(self) -> Pose:
        """The true pose of the base in the frame where the simulation began."""
        x, y, heading = self._data.qpos[self._qpos].tolist()
        return Pose(x, y, math.remainder(heading, math.tau))

    @property
    def odometry(self) -> Pose:
        """The pose that the odometry counts."""
        return self.odometer.pose

    @property
    def velocity(self) -> Velocity:
        """The measured velocity in the frame of the base."""
        return Velocity(*self._data.qvel[self._dof].tolist()).turned(-float(self._data.qpos[self._qpos[2]]))

    @property
    def rolling_w(self) -> float:
        """The mechanical power that rolling takes."""
        return self._part.resistance_n * abs(self.velocity.linear)

    def stations(self) -> list[Station]:
        """Return the charging stations as the base sees them, in the frame of its odometry; far ones as it saw them."""
        for station in self._part.stations:
            true = pose_of(station)
            if true.error_of(self.pose)[0] <= SIGHT_M:
                x, y, heading = (round(each, 4) + 0.0 for each in self.odometer.seen(true))
                self._seen[station.name] = replace(station, x=x, y=y, heading=heading)
        return list(self._seen.values())

    def contact(self) -> str:
        """Return the name of the station that charges the base, empty if none does."""
        return station_at(self.pose, self._part.stations, CONTACT_M, CONTACT_RAD)

    def drive(self, velocity: Velocity) -> None:
        """Drive with this velocity until another one is given."""
        self._wanted = velocity

    def command(self, elapsed_s: float) -> None:
        """Set the servos for the next piece, which turns the base while it lasts."""
        heading = float(self._data.qpos[self._qpos[2]]) + self._wanted.angular * elapsed_s / 2.0
        self._data.ctrl[self._servos] = self._wanted.turned(heading)
        if self._part.drive is not None:
            self._data.ctrl[self._wheel_servos] = self._part.drive.wheels(self._wanted)

    def step(self, elapsed_s: float) -> None:
        """Count the way since the last call."""
        self.odometer.count(self.pose)


def base_of(part: BasePart | LegsPart, base: "SimulatedBase", share: Callable[[], float]) -> VelocityBase:
    """Return the component of a base. ``share`` returns the share of its speed that the robot uses."""
    moves = (BASE, *part.joints) if isinstance(part, LegsPart) else (BASE,)
    docks = isinstance(part, BasePart) and bool(part.stations)

    class Simulated(
        VelocityBase, limits=part.limits, moves=moves, settles_s=base.settles_s, docks=docks, blocking=False
    ):
        __doc__ = base.about
        title, link, corners = part.title, part.link, part.corners

        @property
        def speed_share(self) -> float:
            return share()

        @property
        def standing(self) -> bool:
            return super().standing and not base.walking

        def send(self, velocity: Velocity) -> None:
            base.drive(velocity)

        def measure(self, elapsed_s: float) -> tuple[Pose, Velocity]:
            return base.odometry, base.velocity

        def known_stations(self) -> list[Station]:
            return base.stations() if isinstance(base, RollingBase) else []

        def station_in_contact(self) -> str:
            return base.contact() if isinstance(base, RollingBase) else ""

    return Simulated()


SimulatedBase = RollingBase | WalkingBase
