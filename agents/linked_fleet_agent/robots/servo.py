"""The motor of one joint of a simulated robot, for the part that it drives."""

import math

import mujoco
import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]


class Servo:
    """The position servo ``index``; ``setpoints`` and ``reach`` are those of all servos of the robot.

    The reach is the most by which the setpoint that MuJoCo gets is ahead of the joint. It bounds speed and force.
    """

    def __init__(
        self, model: mujoco.MjModel, data: mujoco.MjData, joint: str, index: int, setpoints: Array, reach: Array
    ) -> None:
        self._data, self._index, self._setpoints, self._reach = data, index, setpoints, reach
        self._qpos, self._dof = int(model.joint(joint).qposadr[0]), int(model.joint(joint).dofadr[0])
        self._stiffness, self._full_reach = float(model.actuator_gainprm[index, 0]), float(reach[index])

    @property
    def position(self) -> float:
        return float(self._data.qpos[self._qpos])

    @property
    def velocity(self) -> float:
        return float(self._data.qvel[self._dof])

    @property
    def effort(self) -> float:
        """The measured effort of the motor."""
        return float(self._data.qfrc_actuator[self._dof])

    def drive(self, setpoint: float, effort: float = math.inf) -> None:
        """Move to ``setpoint`` with this much effort at most."""
        self._setpoints[self._index] = setpoint
        self._reach[self._index] = min(effort / self._stiffness, self._full_reach)

    def push(self, effort: float) -> None:
        """Stay here, with an effort in the direction of its sign; without resistance move a little."""
        self.drive(self.position + effort / self._stiffness, abs(effort))
