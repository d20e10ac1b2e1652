"""Messages that the agent of a robot publishes: description, frames, pictures, progress.

Independent of Zenoh. Each picture is taken on request and shows the robot in a published frame. Progress of motions has
a period, and the ends of motions are repeated for gateways that arrive later. ``Report`` is pure.
"""

import logging
import math
import time
from collections import deque
from collections.abc import Iterable, Mapping, Sequence
from itertools import islice

from msgspec import UNSET, Raw, structs

from linked_fleet_agent.motion import Outcome
from linked_fleet_agent.robot import CameraRobot, Facts, JointFacts, PictureError, Reading, Robot
from linked_fleet_agent.urdf import RobotModel, UrdfError
from linked_fleet_agent.urdf.facts import joint_mismatch
from linked_fleet_agent.wire import codec
from linked_fleet_agent.wire.codec import PictureHeader, WireError, encode_picture
from linked_fleet_agent.wire.components import DescriptionWithComponents
from linked_fleet_agent.wire.messages import (
    MAX_SENSOR_FAULTS,
    MAX_TOLERANCE,
    WIRE_VERSION,
    Base,
    Camera,
    Condition,
    Description,
    Mesh,
    PictureQuery,
    Progress,
    State,
)

_log = logging.getLogger(__name__)


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
    components: bytes = b"",
) -> Description:
    """Return the description of a robot, which holds for one run of its agent, and log what it leaves out.

    ``components`` are its declarations as JSON, if it has some.

    Raises UrdfError for a description that gateways would refuse.
    """
    model, joints = RobotModel.for_urdf(facts.urdf), tuple(joint.name for joint in facts.joints)
    mismatch = joint_mismatch(model, joints)
    if mismatch:
        raise UrdfError(mismatch)
    for finding in model.findings:
        _log.info("%s: %s", name, finding.sentence)
    description = Description(
        version=WIRE_VERSION,
        robot=name,
        incarnation=incarnation,
        title=facts.title,
        urdf=facts.urdf,
        base="floating" if facts.floating else "fixed",
        joints=joints,
        passive=tuple(joint.name for joint in facts.joints if joint.passive),
        tolerances=_tolerances(facts.joints),
        rate_hz=rate_hz,
        capabilities=("move", "follow", "stop"),
        annotations=facts.annotations,
        meshes=meshes,
        cameras=cameras,
        layout=codec.layout(len(facts.joints), facts.floating),
    )
    if not components:
        return description
    return DescriptionWithComponents(components=Raw(components), **structs.asdict(description))


def _tolerances(joints: Iterable[JointFacts]) -> dict[str, float]:
    """Return the known tolerances of the joints that take commands. Raises UrdfError for one that cannot be used."""
    known = dict[str, float]()
    for joint in joints:
        tolerance = joint.arrival_tolerance
        if tolerance is not None and not 0.0 < tolerance <= MAX_TOLERANCE:
            raise UrdfError(
                f"joint {joint.name!r} has a tolerance of {tolerance:g} {joint.unit}; it must be above 0 and at most "
                f"{MAX_TOLERANCE:g} {joint.unit}"
            )
        if tolerance is not None and joint.mimics is None and not joint.passive:
            known[joint.name] = tolerance
    return known


PERIOD_S = 0.05


class Cameras:
    """The cameras of a robot.

    ``take`` is called in a thread, one call at a time. It waits to keep ``PERIOD_S`` between two pictures.
    """

    def __init__(self, robot: Robot, cameras: Sequence[Camera]) -> None:
        self.offers = tuple(cameras) if isinstance(robot, CameraRobot) else ()
        self._robot = robot
        self._cameras = {camera.name: camera for camera in self.offers}
        self._due_s = 0.0

    def take(self, question: bytes, shown: State | None) -> bytes:
        """Return the reply: a picture of the robot in state ``shown`` (None if it could not be read).

        Raises PictureError.
        """
        try:
            asked = codec.decode(question, PictureQuery)
        except WireError as error:
            raise PictureError(f"not a picture query: {error}") from error
        camera = self._cameras.get(asked.camera)
        if camera is None or asked.format not in camera.formats:
            known = ", ".join(f"{each.name} ({', '.join(each.formats)})" for each in self.offers) or "none"
            why = camera.unavailable if camera is not None and camera.unavailable else f"there are {known}"
            raise PictureError(f"no {asked.format} picture of camera {asked.camera!r} is available: {why}")
        if shown is None or not all(map(math.isfinite, shown.positions)):
            raise PictureError("the robot cannot be measured now, so no picture can show its state")
        time.sleep(max(0.0, self._due_s - time.monotonic()))
        self._due_s = time.monotonic() + PERIOD_S
        assert isinstance(self._robot, CameraRobot)
        reading = Reading(shown.positions, shown.velocities, shown.efforts, shown.base)
        content = self._robot.picture(camera, asked.format, reading)
        moment = PictureHeader(
            camera.height, camera.width, shown.incarnation, shown.sequence, shown.monotonic_ns, shown.wall_ns,
            camera.near_m, camera.far_m,
        )  # fmt: skip
        try:
            return encode_picture(asked.format, moment, content)
        except WireError as error:
            raise PictureError(str(error)) from error


PERIOD_NS = 200_000_000
# How long ends are kept for gateways that were not present.
KEPT_NS = 60_000_000_000
MAX_KEPT, MAX_KEPT_BYTES = 256, 4 * 2**20
# A router may announce a gateway before its subscriptions, so that the first message has no receiver.
AGAIN_NS = 1_000_000_000
MAX_POSITIONS = 256


class Report:
    """Progress of the commands of one run of an agent; ``now_ns`` is its monotonic clock."""

    def __init__(self, incarnation: int) -> None:
        self._incarnation = incarnation
        self._ends: deque[tuple[int, str, bytes]] = deque()
        self._asked: list[str] = []
        self._kept_bytes = 0
        self._arrivals = 0
        self._due_ns = 0
        self._again_ns: int | None = None

    def write(self, outcome: Outcome, measured: Mapping[str, float], now_ns: int, wall_ns: int) -> bytes:
        """Return the progress message for ``outcome``. Ends are kept for ``repeat``."""
        known = ((joint, measured[joint]) for joint in outcome.joints if math.isfinite(measured[joint]))
        progress = Progress(
            version=WIRE_VERSION,
            id=outcome.command_id,
            incarnation=self._incarnation,
            state=outcome.state,
            wall_ns=wall_ns,
            reason=outcome.reason[:1024],
            positions=dict(islice(known, MAX_POSITIONS)),
            progress=outcome.progress,
            successor=outcome.successor,
            feedback=UNSET if outcome.feedback is None else Raw(outcome.feedback),
            result=UNSET if outcome.result is None else Raw(outcome.result),
            stream=UNSET if outcome.stream is None else outcome.stream,
        )
        payload = codec.encode(progress)
        if outcome.state != "running":
            self._keep(now_ns, outcome.command_id, payload)
        return payload

    def _keep(self, now_ns: int, id: str, payload: bytes) -> None:
        self._kept_bytes += len(payload)
        while self._ends and (len(self._ends) >= MAX_KEPT or self._kept_bytes > MAX_KEPT_BYTES):
            self._kept_bytes -= len(self._ends.popleft()[2])
        self._ends.append((now_ns, id, payload))

    def repeat(self, arrivals: int, now_ns: int) -> list[bytes]:
        """Return the recent ends: at once if a gateway has arrived, and again a second later; and those asked for.

        Running motions are due then too.
        """
        asked, self._asked = self._asked, []
        if arrivals != self._arrivals:
            self._arrivals, self._due_ns, self._again_ns = arrivals, now_ns, now_ns + AGAIN_NS
        elif self._again_ns is None or now_ns < self._again_ns:
            return [payload for _, id, payload in self._ends if id in asked]
        else:
            self._again_ns = None
        return [payload for ended_ns, _, payload in self._ends if now_ns - ended_ns <= KEPT_NS]

    def repeat_end(self, id: str) -> None:
        """Repeat the end of a command soon, if it is known: a gateway has asked for it."""
        self._asked = [*self._asked, id][-MAX_KEPT:]

    def repeat_later(self, now_ns: int) -> None:
        """Schedule a repetition of the recent ends, because a connection that is being renewed may lose them."""
        self._again_ns = now_ns + AGAIN_NS

    def due(self, now_ns: int) -> bool:
        """Return True if the progress of running motions is due."""
        if now_ns < self._due_ns:
            return False
        self._due_ns = now_ns + PERIOD_NS
        return True


CONDITION_NS = 1_000_000_000
"""Period of the conditions of a robot with a fault."""


class Conditions:
    """The condition of a robot in one run of its agent: published when it changes, and repeated while it is bad."""

    def __init__(self, incarnation: int) -> None:
        self._incarnation = incarnation
        self._last: tuple[str, Mapping[str, str]] = ("", {})
        self._arrivals, self._due_ns = 0, 0

    def due(self, fault: str, sensors: Mapping[str, str], arrivals: int, now_ns: int) -> bytes | None:
        """Return the message to publish now; None if there is none.

        A good condition is published once, and for each gateway that arrives.
        """
        changed = (fault, sensors) != self._last or arrivals != self._arrivals
        if not changed and (not (fault or sensors) or now_ns < self._due_ns):
            return None
        self._last, self._arrivals, self._due_ns = (fault, dict(sensors)), arrivals, now_ns + CONDITION_NS
        told = {name: sentence[:512] for name, sentence in islice(sensors.items(), MAX_SENSOR_FAULTS)}
        return codec.encode(
            Condition(version=WIRE_VERSION, incarnation=self._incarnation, fault=fault[:1024], sensors=told)
        )
