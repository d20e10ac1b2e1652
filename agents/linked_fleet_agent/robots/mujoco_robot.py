"""A simulated robot from any URDF that MuJoCo can load (extra: sim).

The caller of ``MujocoRobot`` steps it; it reads no wall clock.
"""

import math
from collections import deque
from collections.abc import Mapping, Sequence
from pathlib import Path

import mujoco
import numpy as np

from linked_fleet_agent.components import Component, Status
from linked_fleet_agent.components.driving import planar_base
from linked_fleet_agent.robot import Facts, PictureError, Reading, RobotFaultError
from linked_fleet_agent.robots.camera_client import Renderer, Scene
from linked_fleet_agent.robots.mujoco_model import BaseKind, build, commanded_joints
from linked_fleet_agent.robots.parts import NO_PARTS, FingersPart, Parts
from linked_fleet_agent.robots.servo import Servo
from linked_fleet_agent.robots.simulated_base import RollingBase, SimulatedBase
from linked_fleet_agent.robots.simulated_fingers import Fingers
from linked_fleet_agent.robots.simulated_parts import Measured, SimulatedMode, components_of
from linked_fleet_agent.robots.walking_base import WalkingBase
from linked_fleet_agent.urdf.cruise import cruise_of
from linked_fleet_agent.wire.messages import Base, Camera, PictureFormat

# After a stall the simulation catches up by this much at most, so that a slow host does not fall behind further.
MAX_CATCH_UP_S = 0.1
# The computer counts as too slow when stalls left out so much of the last seconds. One stall alone, as when another
# program starts, is no news.
_LOOKED_BACK_S, _TOO_MUCH_S = 10.0, 1.0
_AT_LIMIT = 0.999
# A servo this close to its setpoint counts as holding it. Using its sagged position as the new setpoint would add sag.
_HOLDING_RAD = 0.01


class MujocoRobot:
    """Driver based on MjModel and MjData.

    ``home`` maps joints to their first positions (others: 0), clamped to the limits; ``home_height_m`` is the height of
    a floating base. A base that rolls (``parts.base``) stands on the floor. ``file`` is the path of the URDF, for
    finding its meshes; ``renders_by`` is the OpenGL backend of its cameras (``camera_client.py``). Raises ValueError
    (UrdfError) if no model can be built.

    Components are a mode, diagnostics, the simulation itself, and the ``parts``; ``fingers`` are those of its grippers.
    """

    def __init__(
        self,
        name: str,
        facts: Facts,
        home: Mapping[str, float] | None = None,
        home_height_m: float = 0.0,
        file: Path | None = None,
        renders_by: str = "",
        parts: Parts = NO_PARTS,
    ) -> None:
        self._facts = facts
        self._limits = {joint.name: joint.limits for joint in facts.joints}
        wanted = {joint.name: (home or {}).get(joint.name, 0.0) for joint in facts.joints}
        pose = {joint: self._limits[joint].clamp(position) for joint, position in wanted.items()}
        driving = [part.joints[0] for part in parts.fingers]
        wheels = () if parts.base is None else parts.base.wheels
        kind: BaseKind = "rolling" if parts.base is not None else "floating" if facts.floating else "fixed"
        self._model = build(facts.urdf, name, facts.joints, pose, kind, file, driving, wheels)
        self._data = mujoco.MjData(self._model)
        scene = Scene(
            robot=name, urdf=facts.urdf, file=str(file or ""), floating=facts.floating, home=pose, cameras=facts.cameras
        )
        self._renderer = Renderer(scene, renders_by) if renders_by else None
        self._names = tuple(joint.name for joint in facts.joints)
        joints = [self._model.joint(joint.name) for joint in facts.joints]
        self._qpos = np.array([joint.qposadr[0] for joint in joints], dtype=int)
        self._dof = np.array([joint.dofadr[0] for joint in joints], dtype=int)
        with_servo = [joint.name for joint in commanded_joints(facts.joints, wheels)]
        self._servo = {joint: index for index, joint in enumerate(with_servo)}
        commanded = [self._names.index(joint) for joint in with_servo]
        self._servo_qpos = self._qpos[commanded]
        # A real drive limits its speed. The setpoint leads the joint by at most the distance at which damping balances
        # the servo at the speed limit.
        speeds = np.array([facts.joints[index].limits.velocity or np.inf for index in commanded])
        bias, gain = self._model.actuator_biasprm[: len(commanded)], self._model.actuator_gainprm[: len(commanded)]
        damping_s = (self._model.dof_damping[self._dof[commanded]] - bias[:, 2]) / gain[:, 0]
        self._full_reach = speeds * damping_s
        self._cruise_reach = np.array([cruise_of(facts.joints[index]) for index in commanded]) * damping_s
        self._scale, self._reach = 1.0, self._full_reach.copy()
        self._scaled = np.array([facts.joints[index].name not in driving for index in commanded], dtype=bool)
        self._setpoints = np.zeros(len(commanded))
        self._start_s: float | None = None
        self._stalls = deque[tuple[float, float]]()
        self.fingers = {part.name: self._fingers_of(part) for part in parts.fingers}
        self._driven = dict(zip(driving, self.fingers.values(), strict=True))
        self._place(pose, home_height_m, rolls=parts.base is not None)
        self.base = self._base_of(parts)
        self._mode = SimulatedMode()
        measured = Measured(self._time_s, self._mechanical_w, self._status)
        self._components, self._followers = components_of(parts, self.fingers, self.base, self._mode, measured)

    def describe(self) -> Facts:
        return self._facts

    def components(self) -> Sequence[Component]:
        return self._components

    def read(self, now_s: float) -> Reading:
        """Advance to ``now_s`` and measure. Raises RobotFaultError if the simulation has diverged."""
        self._advance(now_s)
        data = self._data
        if not (np.isfinite(data.qpos).all() and np.isfinite(data.qvel).all()):
            raise RobotFaultError("the simulation has diverged")
        return Reading(
            positions=tuple(data.qpos[self._qpos].tolist()),
            velocities=tuple(data.qvel[self._dof].tolist()),
            efforts=tuple(data.qfrc_actuator[self._dof].tolist()),
            base=self._base(),
        )

    def apply(self, setpoints: Mapping[str, float]) -> dict[str, float]:
        """Set servos.

        Raises KeyError for a joint that takes no commands, ValueError for a setpoint that is not finite.
        """
        measured = self._data.qpos[self._servo_qpos].tolist()
        applied = {
            name: self._limits[name].including(measured[self._servo[name]]).clamp(setpoint)
            for name, setpoint in setpoints.items()
        }
        for name, setpoint in applied.items():
            if not math.isfinite(setpoint):
                raise ValueError(f"setpoint {setpoint} of joint {name!r} is not finite")
            if name not in self._driven or self._driven[name].yields_to(setpoint):
                self._setpoints[self._servo[name]] = setpoint
        return applied

    def stop(self) -> None:
        measured, held = self._data.qpos[self._servo_qpos], self._setpoints
        self._setpoints[:] = np.where(np.abs(measured - held) > _HOLDING_RAD, measured, held)

    def close(self) -> None:
        """End the render process; everything else is memory."""
        if self._renderer is not None:
            self._renderer.close()

    def picture(self, camera: Camera, format: PictureFormat, reading: Reading) -> bytes:
        if self._renderer is None:
            raise PictureError("nothing renders here")
        return self._renderer.take(camera.name, format, reading, self._names)

    def _place(self, pose: Mapping[str, float], height_m: float, rolls: bool) -> None:
        for joint, address in zip(self._facts.joints, self._qpos, strict=True):
            self._data.qpos[address] = pose[joint.name]
        if self._facts.floating and not rolls:
            self._data.qpos[:7] = (0, 0, height_m, 1, 0, 0, 0)
        self._setpoints[:] = self._data.ctrl[: len(self._setpoints)] = self._data.qpos[self._servo_qpos]
        mujoco.mj_forward(self._model, self._data)

    def _advance(self, now_s: float) -> None:
        if self._start_s is None:
            self._start_s = now_s
        step_s = self._model.opt.timestep
        behind_s = now_s - self._start_s - self._data.time
        if behind_s > MAX_CATCH_UP_S:
            self._leave_out(behind_s - MAX_CATCH_UP_S)
            behind_s = MAX_CATCH_UP_S
        steps = int(behind_s / step_s + 1e-6)
        if steps > 0:
            if (scale := self._mode.used_scale) != self._scale:
                self._rescale(scale)
            measured = self._data.qpos[self._servo_qpos]
            lead = np.clip(self._setpoints - measured, -self._reach, self._reach)
            self._data.ctrl[: len(lead)] = measured + lead
            if self.base is not None:
                self.base.command(steps * step_s)
            mujoco.mj_step(self._model, self._data, steps)
            for follow in self._followers:
                follow(steps * step_s)

    def _leave_out(self, seconds: float) -> None:
        assert self._start_s is not None
        self._start_s += seconds
        self._stalls.append((self._data.time, seconds))

    def _rescale(self, scale: float) -> None:
        """Reduce the speed of all joints but fingers to a share of that of motions; 1 is the full speed."""
        self._scale = scale
        reach = self._full_reach if scale == 1.0 else scale * self._cruise_reach
        self._reach[self._scaled] = reach[self._scaled]

    def _fingers_of(self, part: FingersPart) -> Fingers:
        joint = part.joints[0]
        servo = Servo(self._model, self._data, joint, self._servo[joint], self._setpoints, self._reach)
        return Fingers(self._model, self._data, part, servo, self._limits[joint])

    def _base_of(self, parts: Parts) -> SimulatedBase | None:
        if parts.base is not None:
            return RollingBase(self._model, self._data, parts.base, len(self._servo))
        if parts.legs is not None:
            servos = [self._servo[joint] for joint in parts.legs.joints]
            return WalkingBase(self._model, self._data, parts.legs, servos, self._setpoints)
        return None

    def _time_s(self) -> float:
        return float(self._data.time)

    def _mechanical_w(self) -> float:
        rolling_w = self.base.rolling_w if isinstance(self.base, RollingBase) else 0.0
        return rolling_w + float(np.dot(np.abs(self._data.qfrc_actuator), np.abs(self._data.qvel)))

    def _status(self) -> list[Status]:
        said = [self._clock_status(), self._motor_status()]
        if isinstance(self.base, WalkingBase) and self.base.fallen:
            said.append(Status("legs", "error", "the robot has fallen, and does not walk"))
        return said

    def _clock_status(self) -> Status:
        if not np.isfinite(self._data.qpos).all():
            return Status("simulation", "error", "it has diverged")
        while self._stalls and self._stalls[0][0] < self._data.time - _LOOKED_BACK_S:
            self._stalls.popleft()
        left_out_s = sum(seconds for _, seconds in self._stalls)
        if left_out_s >= _TOO_MUCH_S:
            said = f"this computer is too slow: of the last {_LOOKED_BACK_S:.0f} s, {left_out_s:.1f} s were left out"
            return Status("simulation", "warning", said)
        return Status("simulation", "ok", "it runs in real time")

    def _motor_status(self) -> Status:
        limited = self._model.actuator_forcelimited.astype(bool)
        at_limit = np.abs(self._data.actuator_force) >= _AT_LIMIT * self._model.actuator_forcerange[:, 1]
        names = [name for name, index in self._servo.items() if limited[index] and at_limit[index]]
        if not names:
            return Status("motors", "ok", "none is at its effort limit")
        return Status("motors", "warning", f"at the effort limit: {', '.join(names)}"[:1024])

    def _base(self) -> Base | None:
        """Return pose and twist in the odometry frame, or in the world frame of a body without; None if it is fixed."""
        if isinstance(self.base, RollingBase):
            return planar_base(self.base.odometry, self.base.velocity)
        if not self._facts.floating:
            return None
        return self.base.counted(self._body()) if isinstance(self.base, WalkingBase) else self._body()

    def _body(self) -> Base:
        """Return pose and twist of a body that floats. MuJoCo has its angular velocity in its own frame."""
        data = self._data
        angular = np.zeros(3)
        mujoco.mju_rotVecQuat(angular, data.qvel[3:6], data.qpos[3:7])
        x, y, z, qw, qx, qy, qz = data.qpos[:7].tolist()
        vx, vy, vz = data.qvel[:3].tolist()
        wx, wy, wz = angular.tolist()
        return Base((x, y, z), (qx, qy, qz, qw), (vx, vy, vz), (wx, wy, wz))
