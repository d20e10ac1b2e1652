"""The description of a robot, and the frames of its state, as its agent publishes them."""

import math

from linked_fleet_agent.robot import Facts, Reading
from linked_fleet_agent.wire import codec
from linked_fleet_agent.wire.messages import WIRE_VERSION, Base, Camera, Description, Mesh, State


class Frames:
    """Numbers and encodes the frames of one run of an agent."""

    def __init__(self, incarnation: int, facts: Facts) -> None:
        self.latest: State | None = None
        """The latest frame; None if the robot could not be read for it."""
        self.published_ns = 0
        """Monotonic time of the latest frame."""
        self._incarnation, self._sequence = incarnation, 0
        self._unknown = _unknown(facts)

    def encode(self, reading: Reading | None, monotonic_ns: int, wall_ns: int) -> bytes:
        """Return the next frame, with NaN for all values if there is no reading."""
        shown = reading or self._unknown
        state = State(
            incarnation=self._incarnation,
            sequence=self._sequence,
            monotonic_ns=monotonic_ns,
            wall_ns=wall_ns,
            base=shown.base,
            positions=shown.positions,
            velocities=shown.velocities,
            efforts=shown.efforts,
        )
        self.latest = None if reading is None else state
        self._sequence += 1
        self.published_ns = monotonic_ns
        return codec.encode_state(state)


def _unknown(facts: Facts) -> Reading:
    joints = (math.nan,) * len(facts.joints)
    nans: tuple[float, float, float] = (math.nan, math.nan, math.nan)
    return Reading(joints, joints, joints, Base(nans, (*nans, math.nan), nans, nans) if facts.floating else None)


def describe(
    name: str,
    incarnation: int,
    facts: Facts,
    rate_hz: float,
    meshes: tuple[Mesh, ...],
    cameras: tuple[Camera, ...],
) -> Description:
    """Return the description of a robot, which holds for one run of its agent."""
    return Description(
        version=WIRE_VERSION,
        robot=name,
        incarnation=incarnation,
        title=facts.title,
        urdf=facts.urdf,
        base="floating" if facts.floating else "fixed",
        joints=tuple(joint.name for joint in facts.joints),
        rate_hz=rate_hz,
        capabilities=("move", "follow", "stop"),
        annotations=facts.annotations,
        meshes=meshes,
        cameras=cameras,
        layout=codec.layout(len(facts.joints), facts.floating),
    )
