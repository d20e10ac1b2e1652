"""The base of a simulated robot that walks on four legs over the plane of MuJoCo."""

import math
from collections.abc import Sequence

import mujoco
import numpy as np
import numpy.typing as npt

from linked_fleet_agent.planar import STANDING, Pose, Velocity
from linked_fleet_agent.robots.odometry import Odometry
from linked_fleet_agent.robots.parts import LegsPart
from linked_fleet_agent.robots.trot import SETTLES_S, Trot
from linked_fleet_agent.wire.messages import Base

Array = npt.NDArray[np.float64]

_STIFFNESS_NM_RAD, _DAMPING_NM_S_RAD, _ARMATURE_KG_M2 = 400.0, 12.0, 0.02
"""Servos of walking legs, which give way when a foot meets the ground. Those of a stand are stiffer."""
_MEASURED_S, _STEADY_S = 0.1, 0.2
_REST_S, _RISE_S = 0.15, 0.4
"""Time until the joints rest after the last step, and the time in which they then rise to the stand."""
_FALLEN_RAD = 0.7


class WalkingBase:
    """Four legs that trot. ``servos`` are the indices of their servos, and ``setpoints`` those of the robot.

    The servos are soft while the robot walks, and hold the stand that it began with when all feet stand again.
    """

    about = "Four legs that walk: diagonal legs step together."
    settles_s = SETTLES_S + _REST_S + _RISE_S

    def __init__(
        self, model: mujoco.MjModel, data: mujoco.MjData, part: LegsPart, servos: Sequence[int], setpoints: Array
    ) -> None:
        self._model, self._data, self._servos, self._setpoints = model, data, np.array(servos), setpoints
        self._dof = np.array([int(model.joint(name).dofadr[0]) for name in part.joints])
        self._qpos = np.array([int(model.joint(name).qposadr[0]) for name in part.joints])
        self._stiff = self._impedance()
        self._trot, self._stand = Trot(part.legs), np.zeros(len(servos))
        self._rested_s: float | None = None
        self._sagged = self._stand
        self._wanted = self._velocity = STANDING
        self.steady = self.pose
        """The pose without the sway of the body at each step."""
        self.odometer = Odometry(self.steady)

    @property
    def walking(self) -> bool:
        return self._trot.walking or self._rested_s is not None

    @property
    def fallen(self) -> bool:
        """True if the body leans so far that the robot cannot walk."""
        _, x, y, _ = self._data.qpos[3:7].tolist()
        return bool(1.0 - 2.0 * (x**2 + y**2) < math.cos(_FALLEN_RAD))

    @property
    def pose(self) -> Pose:
        """The true pose of the body on the plane."""
        x, y, _, qw, qx, qy, qz = self._data.qpos[:7].tolist()
        return Pose(x, y, math.atan2(2.0 * (qw * qz + qx * qy), 1.0 - 2.0 * (qy**2 + qz**2)))

    @property
    def odometry(self) -> Pose:
        """The pose that the odometry counts."""
        return self.odometer.pose

    @property
    def velocity(self) -> Velocity:
        """The velocity in the frame of the base, without its swing at each step."""
        return self._velocity

    def drive(self, velocity: Velocity) -> None:
        """Walk with this velocity until another one is given."""
        self._wanted = velocity

    def command(self, elapsed_s: float) -> None:
        """Set the servos for the next piece."""
        if self._wanted != STANDING and not self._trot.walking and not self.fallen:
            self._begin()
        if self._trot.walking:
            self._set(np.ravel(self._trot.step(elapsed_s, self._wanted, self.steady, self._velocity)))
            if self.fallen or not self._trot.walking:
                self._trot.walking, self._rested_s = False, 0.0
        elif self._rested_s is not None:
            self._rise(self._rested_s, elapsed_s)

    def _set(self, positions: Array) -> None:
        self._data.ctrl[self._servos] = self._setpoints[self._servos] = positions

    def step(self, elapsed_s: float) -> None:
        """Measure, after the simulation has advanced."""
        self._follow(elapsed_s)
        self.odometer.count(self.steady)
        x, y, _, _, _, angular = self._data.qvel[:6].tolist()
        now, share = Velocity(x, y, angular).turned(-self.pose.heading), min(elapsed_s / _MEASURED_S, 1.0)
        self._velocity = Velocity(
            *(before + share * (each - before) for before, each in zip(self._velocity, now, strict=True))
        )

    def counted(self, true: Base) -> Base:
        """Return where the body is as the odometry counts it, from where it really is."""
        at, steady = self.odometry, self.steady
        turn = at.heading - steady.heading
        cosine, sine = math.cos(turn), math.sin(turn)

        def turned(x: float, y: float) -> tuple[float, float]:
            return x * cosine - y * sine, x * sine + y * cosine

        x, y = turned(true.position_m[0] - steady.x, true.position_m[1] - steady.y)
        qx, qy, qz, qw = true.orientation_xyzw
        half_cosine, half_sine = math.cos(turn / 2.0), math.sin(turn / 2.0)
        return Base(
            (at.x + x, at.y + y, true.position_m[2]),
            (
                half_cosine * qx - half_sine * qy,
                half_cosine * qy + half_sine * qx,
                half_cosine * qz + half_sine * qw,
                half_cosine * qw - half_sine * qz,
            ),
            (*turned(*true.linear_m_s[:2]), true.linear_m_s[2]),
            (*turned(*true.angular_rad_s[:2]), true.angular_rad_s[2]),
        )

    def _follow(self, elapsed_s: float) -> None:
        """Move the steady pose as the base should move, and bring it to where the body is."""
        linear, lateral, angular = (each * elapsed_s for each in self._wanted)
        led, true = self.steady.moved(linear, angular, lateral), self.pose
        share = min(elapsed_s / _STEADY_S, 1.0)
        turn = math.remainder(true.heading - led.heading, math.tau)
        self.steady = Pose(
            led.x + share * (true.x - led.x), led.y + share * (true.y - led.y), led.heading + share * turn
        )

    def _begin(self) -> None:
        if not self.walking:
            self._stand = self._setpoints[self._servos].copy()
        self._rested_s = None
        self._trot.begin([(hip, thigh, calf) for hip, thigh, calf in self._stand.reshape(-1, 3).tolist()], self.steady)
        count = len(self._servos)
        self._set_impedance(
            np.full(count, _STIFFNESS_NM_RAD), np.full(count, _DAMPING_NM_S_RAD), np.full(count, _ARMATURE_KG_M2)
        )

    def _rise(self, rested_s: float, elapsed_s: float) -> None:
        """Make the servos stiff where the legs have come to rest, which is a little below the stand, and rise to it."""
        if rested_s < _REST_S <= rested_s + elapsed_s:
            self._sagged = self._data.qpos[self._qpos].copy()
            self._set_impedance(*self._stiff)
        self._rested_s = rested_s + elapsed_s
        if self._rested_s >= _REST_S:
            share = min((self._rested_s - _REST_S) / _RISE_S, 1.0)
            self._set(self._sagged + share * (self._stand - self._sagged))
            self._rested_s = None if share == 1.0 else self._rested_s

    def _impedance(self) -> tuple[Array, Array, Array]:
        """Return stiffness, damping and armature of the legs."""
        gains, biases = self._model.actuator_gainprm[self._servos, 0], self._model.actuator_biasprm[self._servos, 2]
        return gains.copy(), -biases, self._model.dof_armature[self._dof].copy()

    def _set_impedance(self, stiffness: Array, damping: Array, armature: Array) -> None:
        self._model.actuator_gainprm[self._servos, 0] = stiffness
        self._model.actuator_biasprm[self._servos, 1] = -stiffness
        self._model.actuator_biasprm[self._servos, 2] = -damping
        self._model.dof_armature[self._dof] = armature
