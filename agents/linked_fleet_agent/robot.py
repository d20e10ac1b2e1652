"""The interface of robot drivers. SI units: rad, m, N·m or N."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple, Protocol, runtime_checkable

from linked_fleet_agent.components.component import Component
from linked_fleet_agent.sensors import JointSensor
from linked_fleet_agent.trajectory import Trajectory
from linked_fleet_agent.urdf.facts import JointFacts as JointFacts
from linked_fleet_agent.urdf.limits import Limits as Limits
from linked_fleet_agent.wire.messages import Base, Camera, PictureFormat


class PictureError(Exception):
    """A picture that is not available; the message gives the reason."""


class RobotFaultError(Exception):
    """The robot cannot be read or driven now. The agent reports it and holds until a read succeeds again."""


class NewDescriptionError(Exception):
    """The robot has described itself anew. The agent ends this run and begins another one with the new facts."""


@dataclass(frozen=True)
class Facts:
    """Facts about a robot that are known while it is offline; ``joints`` gives the order of every array in a Reading.

    ``meshes`` maps mesh URIs of the URDF to files (see mesh_files.py); it may be empty. ``cameras`` needs a driver that
    is ``CameraRobot``; their names are unique. ``coupled`` are groups of joints that take setpoints only together, as
    those of a ROS controller: the agent sends setpoints of all joints of a group, or of none.
    """

    title: str
    urdf: str
    joints: tuple[JointFacts, ...]
    floating: bool = False
    annotations: str = ""
    meshes: Mapping[str, Path] = field(default_factory=dict)
    cameras: tuple[Camera, ...] = ()
    coupled: tuple[tuple[str, ...], ...] = ()


class Reading(NamedTuple):
    """Measured values in the order of ``Facts.joints``; NaN is unknown. ``base`` is set exactly on floating bases.

    ``measured_s`` are the times of the positions by the monotonic clock of ``read``; empty means now. ``faults`` gives
    by joint why its sensor cannot be believed; the position of such a joint is NaN. ``held`` gives by joint why it
    takes no commands now, as one whose controller is inactive.
    """

    positions: tuple[float, ...]
    velocities: tuple[float, ...]
    efforts: tuple[float, ...]
    base: Base | None = None
    measured_s: tuple[float, ...] = ()
    faults: Mapping[str, str] = {}
    held: Mapping[str, str] = {}


class Robot(Protocol):
    """A driver. All methods are called from one thread and should return within about a millisecond."""

    def describe(self) -> Facts:
        """Return the facts. Works while the robot is offline and never changes.

        A robot whose facts change raises NewDescriptionError in ``read``, and is loaded again.
        """

    def read(self, now_s: float) -> Reading:
        """Measure. A simulation first advances to ``now_s`` (monotonic seconds); hardware ignores it.

        Raises RobotFaultError, or an error of the hardware library, if nothing can be measured.
        """

    def apply(self, setpoints: Mapping[str, float]) -> Mapping[str, float]:
        """Apply position setpoints and leave other joints alone.

        Return the setpoints really applied, after driver limits. A setpoint beyond a limit of the joint is applied as
        far as the joint is out itself, so that a joint outside its limits can be moved back from where it stands.
        """

    def stop(self) -> None:
        """Hold the present position. Safe at any time and any number of times."""

    def close(self) -> None:
        """Release all resources; the object is not used afterwards."""


@runtime_checkable
class SensingRobot(Protocol):
    """A driver that judges the sensors of its joints itself, because its robot measures more often than it is read."""

    @property
    def sensors(self) -> Mapping[str, JointSensor]:
        """The sensors of all joints, by name. Positions of its readings are those that they believe."""


@runtime_checkable
class ComponentRobot(Protocol):
    """A driver whose robot has components."""

    def components(self) -> Sequence[Component]:
        """Return them; asked once, before the robot is read. Their methods run beside the driver's own."""


class FollowedEnd(NamedTuple):
    """The end of the motion ``id`` by its controllers; ``reason`` says why they did not reach its end."""

    id: str
    reason: str = ""


@runtime_checkable
class TrajectoryRobot(Protocol):
    """A driver whose controllers take whole trajectories, and say how they ended.

    Setpoints for one of their joints, by ``apply``, replace a trajectory.
    """

    def follow(self, id: str, trajectories: Mapping[str, Trajectory]) -> bool:
        """Let controllers follow the trajectories of the motion ``id``, or return False to get setpoints instead.

        ``trajectories`` are those of all joints of each group that is ``coupled`` to the motion.
        """

    def leave(self, id: str) -> None:
        """Let no controller follow the motion ``id`` any more, because the agent has ended it or sends setpoints."""

    def ended(self) -> Sequence[FollowedEnd]:
        """Return the motions that controllers have ended since the last call, but for those that were left."""

    def end_others(self, joints: Collection[str]) -> None:
        """End what other clients of the controllers of these joints move."""

    @property
    def ended_others(self) -> str:
        """A sentence about what the last ``end_others`` has ended, as far as it is known; empty if nothing."""


@runtime_checkable
class CameraRobot(Protocol):
    """A driver whose robot has cameras."""

    def picture(self, camera: Camera, format: PictureFormat, reading: Reading) -> bytes:
        """Return the picture of the robot as in ``reading``: a JPEG or PNG file of the camera's size, or depth values.

        Called in a thread of its own, one call at a time; it may be slow. Depths are little-endian float32 in metre
        along the optical axis, row by row, NaN where nothing is in range. Raises PictureError.
        """
