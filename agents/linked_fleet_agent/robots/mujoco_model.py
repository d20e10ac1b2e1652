"""The MuJoCo model of a robot from its URDF, with a position servo on every joint that takes commands (extra: sim)."""

import logging
import re
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import Literal

import mujoco
import numpy as np

from linked_fleet_agent.robot import JointFacts
from linked_fleet_agent.robots.urdf_repair import simulable_urdf

_log = logging.getLogger(__name__)

BaseKind = Literal["fixed", "floating", "rolling"]

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
# A finger pushes with all its force when its setpoint is this far ahead, and moves no further if the object is lost.
FULL_FORCE_LEAD_M = 0.002
_FASTEST_SERVO_RAD_S = 200.0
PLANE = ("plane x", "plane y", "plane turn")
"""Joints of a base that rolls: where it is on the floor, and its heading."""
_FOOT_RADIUS_M = 0.02


def build(
    urdf: str,
    robot: str,
    joints: Sequence[JointFacts],
    home: Mapping[str, float],
    base: BaseKind,
    file: Path | None,
    fingers: Collection[str] = (),
    wheels: Sequence[str] = (),
) -> mujoco.MjModel:
    """Compile the model. ``fingers`` are joints of grippers.

    Servos are in the order of the joints that take commands. The velocity servos of a rolling base follow, first those
    of ``PLANE``, then those of its ``wheels``. Raises UrdfError or ValueError, with the robot's name, if MuJoCo cannot
    build a model.
    """
    meshes, moving = file if base == "floating" else None, base == "floating"
    commanded = commanded_joints(joints, wheels)
    try:
        model = _compiled(simulable_urdf(urdf, robot, moving, meshes), robot, commanded, base, wheels)
    except ValueError:
        # Often it is one mesh. Each alone is compiled only now, because that takes as long as the robot.
        text = simulable_urdf(urdf, robot, moving, meshes, mesh_fault)
        try:
            model = _compiled(text, robot, commanded, base, wheels)
        except ValueError as error:
            raise ValueError(f"{robot}: this URDF cannot be simulated: {reason_of(error)}") from error
    _size_servos(model, commanded, home, base == "floating", fingers)
    return model


def commanded_joints(joints: Sequence[JointFacts], wheels: Sequence[str] = ()) -> list[JointFacts]:
    """Return the joints with a position servo."""
    return [joint for joint in joints if joint.mimics is None and joint.name not in wheels]


def _compiled(
    text: str, robot: str, commanded: Sequence[JointFacts], base: BaseKind, wheels: Sequence[str]
) -> mujoco.MjModel:
    spec = mujoco.MjSpec.from_string(text)
    _set_up(spec, base == "floating")
    _set_on_ground(spec, robot) if base == "floating" else _fix_base(spec)
    for joint in commanded:
        _add_servo(spec, joint)
    if base == "rolling":
        _add_plane(spec, wheels)
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


def _add_plane(spec: mujoco.MjSpec, wheels: Sequence[str]) -> None:
    """Let the base slide over the floor and turn, and add servos for the velocities of both and of the wheels."""
    slide, hinge = mujoco.mjtJoint.mjJNT_SLIDE, mujoco.mjtJoint.mjJNT_HINGE
    body = spec.worldbody.first_body()
    for name, kind, axis in zip(PLANE, (slide, slide, hinge), ([1, 0, 0], [0, 1, 0], [0, 0, 1]), strict=True):
        body.add_joint(name=name, type=kind, axis=axis)
    for name in (*PLANE, *wheels):
        spec.add_actuator(target=name, trntype=mujoco.mjtTrn.mjTRN_JOINT).set_to_velocity(kv=1.0)


def _add_servo(spec: mujoco.MjSpec, joint: JointFacts) -> None:
    servo = spec.add_actuator(target=joint.name, trntype=mujoco.mjtTrn.mjTRN_JOINT)
    servo.set_to_position(kp=1.0, kv=1.0)
    if joint.limits.effort is not None:
        servo.forcelimited = mujoco.mjtLimited.mjLIMITED_TRUE
        servo.forcerange = [-joint.limits.effort, joint.limits.effort]


def _size_servos(
    model: mujoco.MjModel,
    joints: Sequence[JointFacts],
    home: Mapping[str, float],
    floating: bool,
    fingers: Collection[str],
) -> None:
    """Set critically damped servos for the inertia that each joint carries in the home pose."""
    inertias = _carried_inertias(model, home)
    for index, joint in enumerate(joints):
        dof = model.joint(joint.name).dofadr[0]
        inertia = inertias[dof] + (ARMATURE_KG if joint.linear else ARMATURE_KG_M2)
        stiffness = max(inertia * SERVO_RAD_S**2, model.dof_frictionloss[dof] / FRICTION_ERROR)
        if floating and not joint.linear:
            stiffness = max(stiffness, STANDING_STIFFNESS_NM_RAD)
        if joint.name in fingers:
            stiffness = max(stiffness, (joint.limits.effort or 0.0) / FULL_FORCE_LEAD_M)
        # A stiff servo on a light link must stay within the bandwidth of the timestep.
        inertia = max(inertia, stiffness / _FASTEST_SERVO_RAD_S**2)
        model.dof_armature[dof] += inertia - inertias[dof]
        # The joint's own damping reduces the damping that the servo must add.
        damping = max(0.0, 2.0 * np.sqrt(stiffness * inertia) - model.dof_damping[dof])
        model.actuator_gainprm[index, 0] = stiffness
        model.actuator_biasprm[index, 1:3] = -stiffness, -damping
    for index in range(len(joints), model.nu):  # velocities, which are reached within a timestep or two
        gain = inertias[model.jnt_dofadr[model.actuator_trnid[index, 0]]] / model.opt.timestep
        model.actuator_gainprm[index, 0], model.actuator_biasprm[index, 2] = gain, -gain
    mujoco.mj_setConst(model, mujoco.MjData(model))


def _carried_inertias(model: mujoco.MjModel, home: Mapping[str, float]) -> np.ndarray:
    data = mujoco.MjData(model)
    for name, position in home.items():
        data.qpos[model.joint(name).qposadr[0]] = position
    mujoco.mj_forward(model, data)
    matrix = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, matrix)
    return np.diagonal(matrix).copy()
