"""One robot as the gateway knows it: presence, description and latest frame."""

import copy
import math
from collections.abc import Callable, Iterator, Mapping, Sequence, Set
from dataclasses import dataclass
from typing import Any, Literal, Self

from msgspec.structs import replace

from linked_fleet_agent.urdf.facts import joint_mismatch
from linked_fleet_agent.wire.codec import MAX_JOINTS, Header, WireError, decode_state, layout
from linked_fleet_agent.wire.messages import Condition, Description, State
from linked_fleet_state.events import Frames, Latest, Received
from linked_fleet_state.invocation import Lease
from linked_fleet_state.kinematics import ORIGIN, LinkPoses, base_pose
from linked_fleet_state.model import ModelError, Pose, RobotModel
from linked_fleet_state.observation import Bounds, Observation, Observations, bounds_of, joints_outside
from linked_fleet_state.unchecked import UncheckedLink

Row = Literal["positions", "velocities", "efforts"]
"""The measured values of joints (SI units)."""
LinkQuality = Literal["linkGood", "linkWeak", "linkLost"]
"""The reception of frames: the local name of a term of the vocabulary (``reception.py``)."""
Annotations = tuple[str, str]
"""Turtle with the IRI of the robot as base: the annotations of its agent, and those of clients."""


@dataclass(slots=True)
class _Present:
    """The present frame: its header, and what is computed from its values on demand. Empty if no frame is usable."""

    payload: bytes | None = None
    sequence: int | None = None
    wall_ns: int | None = None
    decoded: bool = False
    state: State | None = None
    positions: Mapping[str, float] | None = None
    derived: Set[str] = frozenset()
    poses: LinkPoses | None = None


@dataclass(frozen=True)
class KeptPose:
    """A pose that is kept as a resource of its own at ``path``: positions (rad or m) by joint."""

    path: str
    positions: Mapping[str, float]


class Robot:
    """One robot, changed by ``Fleet`` only. Times in nanoseconds, values in SI units, NaN is unknown.

    Until a restarted agent has described itself, the description of the previous run stays readable and every value is
    unknown. While the robot is offline, its last frame stays.
    """

    def __init__(self, name: str, complain: Callable[[str, object], None], frames: Frames) -> None:
        self.name = name
        self.online = False
        self.incarnation: int | None = None
        self.description: Description | None = None
        self.described = False
        """True if the present run of the agent has sent a usable description."""
        self.model: RobotModel | None = None
        self.heard_ns: int | None = None
        """Gateway wall time of the agent's last message other than a frame."""
        self.news = (0, 0)
        """The last change not caused by a frame: the number of frames before it, and a counter of such changes since
        then.
        """
        self.lease: Lease | None = None
        self.settings: Mapping[str, str] = {}
        """Settings made by clients: ``title``, ``annotations`` (Turtle), ``maximumSpeedScale`` …"""
        self.targets: dict[str, float] = {}
        """The valid target positions of joints (rad or m)."""
        self.unchecked: tuple[UncheckedLink, ...] = ()
        """The links that checks of motions do not cover, once its shapes are prepared."""
        self.parts: Mapping[str, Any] = {}
        """Parts that extensions have added beside joints and links, by path segment (``resources/part.py``)."""
        self.kept_poses: Mapping[str, KeptPose] = {}
        """Poses that an extension keeps for it, by title."""
        self.findings: tuple[str, ...] = ()
        """Sentences about parts that could not be taken."""
        self.stopped_ns = -1
        """The time of its last stop by this gateway (monotonic time of the agent)."""
        self._complain = complain
        self._fault: str | None = None
        self._usable = False
        """True if the description can be used, whichever run it is of."""
        self.moving = False
        """True while its measured positions change, whoever causes it."""
        self.moved_ns: int | None = None
        """Gateway wall time of the last movement in its frames."""
        self.link_quality: LinkQuality | None = None
        """None if unknown."""
        self.limit_fault: str | None = None
        """A sentence if positions have been outside the limits of the URDF for a while."""
        self.agent_fault = ""
        """A sentence why its agent cannot read or drive it; empty if it can."""
        self.sensor_faults: Mapping[str, str] = {}
        """By joint a sentence why its sensor cannot be believed, as its agent says."""
        self._index: Mapping[str, int] = {}
        """Place of each joint in the rows of a frame."""
        self._bounds: Mapping[str, Bounds] = {}
        self._observations = Observations()
        self._frames = frames
        self._latest: Latest | None = None
        self._frame: Received | None = None
        self._present = _Present()

    @property
    def floats(self) -> bool:
        """True if it has described a base that is not fixed."""
        return self.description is not None and self.description.base == "floating"

    @property
    def fault(self) -> str | None:
        """A sentence about what restricts this robot; None if nothing does."""
        return self._fault or self.agent_fault or self.limit_fault or next(iter(self.sensor_faults.values()), None)

    @property
    def presence(self) -> Literal["online", "offline", "faulty"]:
        return "offline" if not self.online else "faulty" if self.fault else "online"

    @property
    def presence_facts(self) -> tuple[str, int | None, str | None]:
        """The facts about its presence that descriptions state."""
        return self.presence, None if self.online else self.last_seen_ns, self.fault

    @property
    def commanded(self) -> tuple[str, ...]:
        """The joints of its frames that take commands, as far as its agent says."""
        said = self.description
        if said is None:
            return ()
        return said.joints if not said.passive else tuple(each for each in said.joints if each not in said.passive)

    @property
    def title(self) -> str:
        said = self.description.title if self.description is not None else ""
        return self.settings.get("title") or said or self.name

    @property
    def annotations(self) -> Annotations:
        said = self.description.annotations if self.description is not None else ""
        return said, self.settings.get("annotations", "")

    @property
    def speed_scale(self) -> float:
        """The speed share that clients have set, above 0, at most 1."""
        return float(self.settings.get("maximumSpeedScale", 1.0))

    @property
    def last_seen_ns(self) -> int | None:
        """Gateway wall time of the agent's last message, current even if the latest frame is not yet adopted."""
        latest = self._latest
        frame_ns = None if latest is None else latest.frame[1]
        return max((each for each in (self.heard_ns, frame_ns) if each is not None), default=None)

    def adopt_latest_frame(self) -> bool:
        """Make the latest frame the present one. Return True if it has changed.

        For the event loop only: between two calls all properties of the robot refer to one frame.
        """
        latest = self._latest
        if latest is None or latest.frame is self._frame:
            return False
        self._frame = latest.frame
        self._renew()
        return True

    @property
    def sequence(self) -> int | None:
        """The number of the present frame; None before the first frame of the present incarnation."""
        return self._present.sequence

    @property
    def wall_ns(self) -> int | None:
        """The agent's wall time of the present frame."""
        return self._present.wall_ns

    @property
    def received_ns(self) -> int | None:
        """Gateway wall time at which the present frame came; None if there is none."""
        return None if self._frame is None or self._present.payload is None else self._frame[1]

    @property
    def arrived(self) -> tuple[int, int, int] | None:
        """The number of frames so far, number and gateway wall time of the last one; None before the first."""
        latest = self._latest
        if latest is None:
            return None
        count, (_, now_ns, sequence, _) = latest.count, latest.frame
        return count, sequence, now_ns

    @property
    def payload(self) -> bytes | None:
        """The present frame as received."""
        return self._present.payload

    @property
    def frame(self) -> State | None:
        """The present frame, unpacked on demand; None before the first frame and if it is malformed."""
        present = self._present
        if not present.decoded:
            present.decoded = True
            try:
                present.state = None if present.payload is None else decode_state(present.payload)
            except WireError as error:
                self._complain(self.name, error)
        return present.state

    @property
    def positions(self) -> Mapping[str, float]:
        """Positions in rad or m for every movable joint of the model and every joint of the description."""
        present = self._present
        if present.positions is None:
            frame, found = self.frame, {} if self.model is None else dict(self.model.unknown_positions)
            if frame is not None:
                found.update(zip(self._index, frame.positions, strict=True))
            present.positions, present.derived = found, frozenset(self._derive(found))
        return present.positions

    def _derive(self, positions: dict[str, float]) -> Iterator[str]:
        """Add the positions of joints that mimic others and are not measured themselves. Yield their names."""
        for name, mimic in () if self.model is None else self.model.mimics:
            leader = positions.get(mimic.joint, math.nan)
            if math.isnan(positions.get(name, math.nan)) and math.isfinite(leader):
                positions[name] = mimic.multiplier * leader + mimic.offset
                yield name

    def link_pose(self, link: str) -> Pose | None:
        """Return the pose in the world frame (fixed base: the frame of the root link); None if unknown."""
        poses = self._link_poses()
        return None if poses is None else poses.pose(link)

    def pose_between(self, frame: str, link: str) -> Pose | None:
        """Return the pose of ``link`` in ``frame``, another link of the model; None if unknown.

        It may be known although both poses are unknown, as behind a floating joint.
        """
        poses = self._link_poses()
        return None if poses is None else poses.between(frame, link)

    def _link_poses(self) -> LinkPoses | None:
        present = self._present
        if present.poses is None:
            frame = self.frame
            if frame is None or self.model is None or self.description is None:
                return None
            root = base_pose(frame.base) if self.description.base == "floating" else ORIGIN
            present.poses = LinkPoses(self.model, self.positions, root)
        return present.poses

    def observe(self, key: str, values: tuple[float, ...], resolution: float) -> Observation:
        """Return the held observation of ``key``, which changes only if a value moves by ``resolution``.

        The stamp is the agent's wall time of the frame with the change. A new incarnation or description resets it.
        """
        present = self._present
        return self._observations.observe(key, values, resolution, present.wall_ns, present.sequence)

    def observe_joint(self, joint: str, row: Row, resolution: float) -> Observation:
        """Return a measured value of a joint; a position is marked if it is outside its limits, or derived."""
        frame, index, present = self.frame, self._index.get(joint), self._present
        value = math.nan if frame is None or index is None else getattr(frame, row)[index]
        if value != value and row == "positions":
            value = self.positions.get(joint, math.nan)
        bounds, key = self._bounds.get(joint) if row == "positions" else None, f"{joint}/{row}"
        return self._observations.observe(
            key, (value,), resolution, present.wall_ns, present.sequence, bounds,
            row == "positions" and joint in present.derived,
        )  # fmt: skip

    def joints_outside_limits(self) -> list[tuple[str, float]]:
        """Return the joints whose positions in the present frame are outside their limits."""
        payload = self._present.payload
        if payload is None or self.description is None:
            return []
        return joints_outside(payload, self.description.base == "floating", self._bounds)

    def standing_at(self, positions: Mapping[str, float]) -> Self:
        """Return a copy that stands still with some of its joints elsewhere (rad or m). No frame changes the copy.

        A joint without a measured position has none in the copy either.
        """
        other, frame = copy.copy(self), self.frame
        other._latest = None
        other._observations = Observations()
        other.moving = False
        if frame is not None:
            places = tuple(positions.get(name, now) for name, now in zip(self._index, frame.positions, strict=True))
            still = (0.0,) * len(places)
            state = replace(frame, positions=places, velocities=still)
            other._present = _Present(*self._header(), decoded=True, state=state)
        return other

    def _header(self) -> tuple[bytes | None, int | None, int | None]:
        present = self._present
        return present.payload, present.sequence, present.wall_ns

    # The following methods are for Fleet only.

    def start_run(self, incarnation: int) -> None:
        """Start another run of the agent: the values measured by the previous run are dropped."""
        self.incarnation = incarnation
        self.news = (0, 0)
        self.targets = {}
        self._fault = self.limit_fault = None
        self.agent_fault, self.sensor_faults = "", {}
        self.drop_frame()
        self._observations.clear()

    def set_parts(self, parts: Mapping[str, Any], findings: Sequence[str]) -> None:
        self.parts, self.findings = parts, tuple(findings)
        self.count_change()

    def set_poses(self, poses: Mapping[str, KeptPose]) -> None:
        self.kept_poses = poses
        self.count_change()

    def set_condition(self, condition: Condition) -> bool:
        """Store what the agent says about its robot. Return False if it says nothing new."""
        if (condition.fault, condition.sensors) == (self.agent_fault, self.sensor_faults):
            return False
        self.agent_fault, self.sensor_faults = condition.fault, condition.sensors
        self.count_change()
        return True

    def set_online(self, online: bool) -> None:
        self.online = online
        self.count_change()

    def matches_description(self, said: Description | str) -> bool:
        """Return True if this is the description that it shows, or the reason for which it has none."""
        if isinstance(said, str):
            return self.description is None and said == self._fault
        # The fault of a description is cleared when another run appears, and may be that of this run again.
        return said == self.description and (self.described or self._fault is not None)

    def describe(self, description: Description) -> None:
        """Store a description; ``fault`` is set if it is unusable."""
        self.count_change()
        self.check_next_frame()
        old = self.description
        if old is None or old.urdf != description.urdf:
            self.model = None
            self.unchecked = ()
        self.description, self._fault, self.limit_fault, self._usable = description, None, None, False
        try:
            self.model = self.model or RobotModel.for_urdf(description.urdf)
        except ModelError as error:
            self._fault = str(error)
        else:
            self._fault = _mismatch(description, self.model)
            self._index = {} if self._fault else {name: place for place, name in enumerate(description.joints)}
            self._bounds = {} if self._fault else bounds_of(self.model, description.joints)
            if self._fault:
                self.model = None  # frames do not match this tree, so it is not shown
        self._usable = not self._fault
        self._observations.clear()
        self._renew()

    def reject_description(self, reason: str) -> None:
        """Become faulty because the description is unusable. The robot stays visible."""
        self.count_change()
        self.check_next_frame()
        self.description = self.model = None
        self._fault = reason
        self._observations.clear()
        self._renew()

    def store_frame(self, header: Header, payload: bytes, now_ns: int) -> None:
        """Store a frame without decoding its values.

        Frames that continue it are then stored beside it, for ``adopt_latest_frame``.
        """
        before = 0 if self._latest is None else self._latest.count
        self._latest = Latest(self.name, (payload, now_ns, header.sequence, header.wall_ns), before + 1)
        self._frame = self._latest.frame
        self._renew()
        self._frames.open(self._latest)

    def accept_frame(self) -> None:
        """Accept the frame that arrived before the description. It has not been reported yet."""
        if self._latest is not None:
            self._latest = Latest(self.name, self._latest.frame, self._latest.count)
            self._frames.open(self._latest)

    def mark_reported(self) -> bool:
        """Record that watchers are being told of all frames so far. Return False if there is no usable frame."""
        if self._latest is not None:
            self._latest.scheduled = self._latest.unreported = False
            self.adopt_latest_frame()
        return self._present.payload is not None

    def last_sequence(self) -> int:
        """Return the number of the present frame, also before a description; -1 before the first."""
        return -1 if self._frame is None else self._frame[2]

    def frame_mismatch(self, header: Header) -> str | None:
        """Return why a frame does not match the description; None if it does or there is no description."""
        if not self.described or self.description is None:
            return None
        joints, floating = len(self.description.joints), self.description.base == "floating"
        if (header.joint_count, header.floating) == (joints, floating):
            return None
        base = {True: "floating", False: "fixed"}
        return (
            f"a frame of {header.joint_count} joints and a {base[header.floating]} base, "
            f"but the description has {joints} and a {base[floating]} one"
        )

    def drop_frame(self) -> None:
        self.check_next_frame()
        self._latest = self._frame = None
        self._renew()

    def count_change(self) -> None:
        """Count a change that no frame caused."""
        self.adopt_latest_frame()
        frames, count = self.last_sequence() + 1, self.news[1]
        self.news = (frames, count + 1 if frames == self.news[0] else 1)

    def check_next_frame(self) -> None:
        """Make the next frame be checked fully before it is stored."""
        self.adopt_latest_frame()
        self._frames.close(self.name)

    def _renew(self) -> None:
        """Replace what was computed from another frame, or under another run or description."""
        said = self.description
        self.described = said is not None and said.incarnation == self.incarnation and self._usable
        if self.described and self._frame is not None:
            payload, _, sequence, wall_ns = self._frame
            self._present = _Present(payload, sequence, wall_ns)
        else:
            self._present = _Present()


def _mismatch(description: Description, model: RobotModel) -> str | None:
    """Return how the description contradicts its URDF or the wire protocol; None if it does not."""
    joints = description.joints
    if len(joints) > MAX_JOINTS:
        return f"the description lists more than {MAX_JOINTS} joints"
    mismatch = joint_mismatch(model, joints)
    if mismatch:
        return mismatch
    if description.layout != layout(len(joints), description.base == "floating"):
        return f"the layout in the description is not that of a frame of {len(joints)} joints and its base"
    return None
