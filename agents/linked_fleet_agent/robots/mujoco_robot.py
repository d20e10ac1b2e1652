"""A simulated robot from any URDF that MuJoCo can load (extra: sim).

``build`` makes the MuJoCo model, with a position servo on every joint that takes commands. The caller of
``MujocoRobot`` steps it; it reads no wall clock.
"""

import logging
import math
import re
from collections.abc import Mapping, Sequence
from pathlib import Path

import mujoco
import numpy as np

from linked_fleet_agent.robot import Facts, JointFacts, PictureError, Reading, RobotFaultError
from linked_fleet_agent.robots.camera_client import Renderer, Scene
from linked_fleet_agent.robots.urdf_repair import simulable_urdf
from linked_fleet_agent.wire.messages import Base, Camera, PictureFormat

_log = logging.getLogger(__name__)

FIXED_TIMESTEP_S = 0.005
FLOATING_TIMESTEP_S = 0.002
# Natural frequency of a servo with the inertia it carries: stiff enough for millimetres, slow enough for the timestep.
SERVO_RAD_S = 50.0
# Servo error from dry friction at rest (half of the arrival tolerance), and the stiffness that carries a legged robot:
# 15 kg cause an error of 1e-4 rad.
FRICTION_ERROR = 1e-4
STANDING_STIFFNESS_NM_RAD = 60_000.0
# Added to every link, like the rotor inertia of a geared motor.
ARMATURE_KG_M2, ARMATURE_KG = 0.01, 0.1
_FASTEST_SERVO_RAD_S = 200.0
_FOOT_RADIUS_M = 0.02


def build(
    urdf: str, robot: str, joints: Sequence[JointFacts], home: Mapping[str, float], floating: bool, file: Path | None
) -> mujoco.MjModel:
    """Compile the model. Servos are in the order of the joints that take commands.

    Raises UrdfError or ValueError, with the robot's name, if MuJoCo cannot build a model.
    """
    meshes, commanded = file if floating else None, [joint for joint in joints if joint.mimics is None]
    try:
        model = _compiled(simulable_urdf(urdf, robot, floating, meshes), robot, commanded, floating)
    except ValueError:
        # Often it is one mesh. Each alone is compiled only now, because that takes as long as the robot.
        text = simulable_urdf(urdf, robot, floating, meshes, mesh_fault)
        try:
            model = _compiled(text, robot, commanded, floating)
        except ValueError as error:
            raise ValueError(f"{robot}: this URDF cannot be simulated: {reason_of(error)}") from error
    _size_servos(model, commanded, home, floating)
    return model


def _compiled(text: str, robot: str, commanded: Sequence[JointFacts], floating: bool) -> mujoco.MjModel:
    spec = mujoco.MjSpec.from_string(text)
    _set_up(spec, floating)
    _set_on_ground(spec, robot) if floating else _fix_base(spec)
    for joint in commanded:
        _add_servo(spec, joint)
    return spec.compile()


def mesh_fault(path: str) -> str:
    """Return why MuJoCo cannot use a mesh file; empty if it can."""
    spec = mujoco.MjSpec()
    spec.add_mesh(name="mesh", file=path)
    spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname="mesh")
    try:
        spec.compile()
    except ValueError as error:
        return reason_of(error)
    return ""


def reason_of(error: ValueError) -> str:
    """Return what MuJoCo says, without its numbers of elements and of lines of a text that nobody has written."""
    said, _, element = str(error).removeprefix("Error: ").partition("\nElement name ")
    said = re.sub(r",? ?\(?(at )?\bline \d+(, column \d+)?\)?", "", said).strip()
    name = element.rpartition(", id")[0].strip("'")
    return f"{said} ({name})" if name and name != "mesh" else said


def _set_up(spec: mujoco.MjSpec, floating: bool) -> None:
    spec.option.timestep = FLOATING_TIMESTEP_S if floating else FIXED_TIMESTEP_S
    # This integrator is implicit in velocity, so that strong damping on light links is stable at this timestep.
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    # A diverged simulation must show as a fault and not silently restart at zero.
    spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET
    for equality in spec.equalities:  # mimic joints follow within a few timesteps
        equality.solref = [4.0 * spec.option.timestep, 1.0]


def _fix_base(spec: mujoco.MjSpec) -> None:
    """Set up a fixed base: compensate gravity and disable contacts.

    The motors do not carry the weight: Baxter's arms, which real springs support, exceed its effort limits.
    """
    spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
    for body in spec.bodies[1:]:
        body.gravcomp = 1.0


def _set_on_ground(spec: mujoco.MjSpec, robot: str) -> None:
    """Set up a floating base on a plane. The robot touches only the ground, never itself."""
    spec.worldbody.first_body().add_freejoint()
    if not spec.geoms:
        _log.warning(
            "%s: no collision geometry could be loaded; the last links get a foot of %g m", robot, _FOOT_RADIUS_M
        )
        for body in spec.bodies[1:]:
            if body.first_body() is None:
                body.add_geom(type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[_FOOT_RADIUS_M, 0, 0])
    for geom in spec.geoms:
        geom.contype, geom.conaffinity, geom.friction = 0, 1, [1.0, 0.02, 0.001]
        geom.mass, geom.density = 0.0, 0.0
    ground = spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_PLANE, size=[0, 0, 1])
    ground.contype, ground.conaffinity, ground.friction = 1, 0, [1.0, 0.02, 0.001]


def _add_servo(spec: mujoco.MjSpec, joint: JointFacts) -> None:
    servo = spec.add_actuator(target=joint.name, trntype=mujoco.mjtTrn.mjTRN_JOINT)
    servo.set_to_position(kp=1.0, kv=1.0)
    if joint.limits.effort is not None:
        servo.forcelimited = mujoco.mjtLimited.mjLIMITED_TRUE
        servo.forcerange = [-joint.limits.effort, joint.limits.effort]


def _size_servos(
    model: mujoco.MjModel, joints: Sequence[JointFacts], home: Mapping[str, float], floating: bool
) -> None:
    """Set critically damped servos for the inertia that each joint carries in the home pose."""
    inertias = _carried_inertias(model, home)
    for index, joint in enumerate(joints):
        dof = model.joint(joint.name).dofadr[0]
        inertia = inertias[dof] + (ARMATURE_KG if joint.linear else ARMATURE_KG_M2)
        stiffness = max(inertia * SERVO_RAD_S**2, model.dof_frictionloss[dof] / FRICTION_ERROR)
        if floating and not joint.linear:
            stiffness = max(stiffness, STANDING_STIFFNESS_NM_RAD)
        # A stiff servo on a light link must stay within the bandwidth of the timestep.
        inertia = max(inertia, stiffness / _FASTEST_SERVO_RAD_S**2)
        model.dof_armature[dof] += inertia - inertias[dof]
        # The joint's own damping reduces the damping that the servo must add.
        damping = max(0.0, 2.0 * np.sqrt(stiffness * inertia) - model.dof_damping[dof])
        model.actuator_gainprm[index, 0] = stiffness
        model.actuator_biasprm[index, 1:3] = -stiffness, -damping
    mujoco.mj_setConst(model, mujoco.MjData(model))


def _carried_inertias(model: mujoco.MjModel, home: Mapping[str, float]) -> np.ndarray:
    data = mujoco.MjData(model)
    for name, position in home.items():
        data.qpos[model.joint(name).qposadr[0]] = position
    mujoco.mj_forward(model, data)
    matrix = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, matrix)
    return np.diagonal(matrix).copy()


# After a stall the simulation catches up by this much at most, so that a slow host does not fall behind further.
MAX_CATCH_UP_S = 0.1
# A servo this close to its setpoint counts as holding it. Using its sagged position as the new setpoint would add sag.
_HOLDING_RAD = 0.01


class MujocoRobot:
    """Driver based on MjModel and MjData.

    ``home`` maps joints to their first positions (others: 0), clamped to the limits; ``home_height_m`` is the height of
    a floating base. ``file`` is the path of the URDF, for finding its meshes; ``renders_by`` is the OpenGL backend of
    its cameras (``camera_client.py``). Raises ValueError (UrdfError) if no model can be built.
    """

    def __init__(
        self,
        name: str,
        facts: Facts,
        home: Mapping[str, float] | None = None,
        home_height_m: float = 0.0,
        file: Path | None = None,
        renders_by: str = "",
    ) -> None:
        self._facts = facts
        self._limits = {joint.name: joint.limits for joint in facts.joints}
        wanted = {joint.name: (home or {}).get(joint.name, 0.0) for joint in facts.joints}
        pose = {joint: self._limits[joint].clamp(position) for joint, position in wanted.items()}
        self._model = build(facts.urdf, name, facts.joints, pose, facts.floating, file)
        self._data = mujoco.MjData(self._model)
        scene = Scene(
            robot=name, urdf=facts.urdf, file=str(file or ""), floating=facts.floating, home=pose, cameras=facts.cameras
        )
        self._renderer = Renderer(scene, renders_by) if renders_by else None
        self._names = tuple(joint.name for joint in facts.joints)
        joints = [self._model.joint(joint.name) for joint in facts.joints]
        self._qpos = np.array([joint.qposadr[0] for joint in joints], dtype=int)
        self._dof = np.array([joint.dofadr[0] for joint in joints], dtype=int)
        commanded = [index for index, joint in enumerate(facts.joints) if joint.mimics is None]
        self._servo = {facts.joints[index].name: servo for servo, index in enumerate(commanded)}
        self._servo_qpos = self._qpos[commanded]
        # A real drive limits its speed. The setpoint leads the joint by at most the distance at which damping balances
        # the servo at the speed limit.
        speeds = np.array([facts.joints[index].limits.velocity or np.inf for index in commanded])
        damping = self._model.dof_damping[self._dof[commanded]] - self._model.actuator_biasprm[:, 2]
        self._reach = speeds * damping / self._model.actuator_gainprm[:, 0]
        self._setpoints = np.zeros(len(commanded))
        self._start_s: float | None = None
        self._place(pose, home_height_m)

    def describe(self) -> Facts:
        return self._facts

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
            base=self._base() if self._facts.floating else None,
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

    def _place(self, pose: Mapping[str, float], height_m: float) -> None:
        for joint, address in zip(self._facts.joints, self._qpos, strict=True):
            self._data.qpos[address] = pose[joint.name]
        if self._facts.floating:
            self._data.qpos[:7] = (0, 0, height_m, 1, 0, 0, 0)
        self._setpoints[:] = self._data.ctrl[:] = self._data.qpos[self._servo_qpos]
        mujoco.mj_forward(self._model, self._data)

    def _advance(self, now_s: float) -> None:
        if self._start_s is None:
            self._start_s = now_s
        step_s = self._model.opt.timestep
        behind_s = now_s - self._start_s - self._data.time
        if behind_s > MAX_CATCH_UP_S:
            self._start_s += behind_s - MAX_CATCH_UP_S
            behind_s = MAX_CATCH_UP_S
        steps = int(behind_s / step_s + 1e-6)
        if steps > 0:
            measured = self._data.qpos[self._servo_qpos]
            self._data.ctrl[:] = measured + np.clip(self._setpoints - measured, -self._reach, self._reach)
            mujoco.mj_step(self._model, self._data, steps)

    def _base(self) -> Base:
        """Return pose and twist in the world frame.

        MuJoCo has the angular velocity of a free joint in the body frame.
        """
        data = self._data
        angular = np.zeros(3)
        mujoco.mju_rotVecQuat(angular, data.qvel[3:6], data.qpos[3:7])
        x, y, z, qw, qx, qy, qz = data.qpos[:7].tolist()
        vx, vy, vz = data.qvel[:3].tolist()
        wx, wy, wz = angular.tolist()
        return Base((x, y, z), (qx, qy, qz, qw), (vx, vy, vz), (wx, wy, wz))
