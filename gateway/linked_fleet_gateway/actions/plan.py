"""Requests of actions, and the motions and halts that handlers make of them."""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field

from msgspec import UNSET, Raw, Struct, json
from msgspec.structs import replace
from pyoxigraph import NamedNode

from linked_fleet_agent.wire.components import COMPONENTS_VERSION, Operate
from linked_fleet_agent.wire.messages import WIRE_VERSION, Command, Expectation, Follow, Move
from linked_fleet_base.errors import Offline
from linked_fleet_gateway.resources.body_values import Body
from linked_fleet_gateway.resources.paths import joint_or_link, robot_path
from linked_fleet_identity.rights import ALL, EVERYBODY, Identity, View
from linked_fleet_state.driving import Drive, FollowedPath
from linked_fleet_state.jogging import JointDrive
from linked_fleet_state.model import Joint, RobotModel
from linked_fleet_state.robot import Robot


class RobotTime(Struct, frozen=True):
    """The time of a request by the robot's own clock: its run, and the monotonic time of its latest frame.

    The command keeps this time whatever delays follow (Redis, a turn), so it is refused as stale after too long (that
    Redis takes long does not count for rules and missions) or after a stop.
    """

    incarnation: int
    seen_ns: int


class Act(Struct, frozen=True):
    """A request to a component of a robot: an action, or a property to set.

    ``input`` is JSON. ``moves`` names what it moves: joints, or ``base``; nothing if it is no motion. One that
    ``resumes`` goes on when the agent ends. ``drive`` or
    ``path`` is what a base, or joints, do by it, if that is known. ``stream`` opens an action as a stream.
    """

    component: str
    input: bytes
    action: str = ""
    property: str = ""
    moves: tuple[str, ...] = ()
    resumes: bool = False
    stream: bool = False
    drive: Drive | JointDrive | None = None
    path: FollowedPath | None = None

    def slowed(self, share: float) -> "Act":
        """Return the request with a share of the speed of its drive."""
        assert self.drive is not None
        drive = self.drive.slowed(share)
        return replace(self, input=json.encode(json.decode(self.input) | drive.input), drive=drive)


class Motion(Struct, frozen=True):
    """A planned motion, or another request that a robot carries out.

    ``targets`` are the final positions (rad or m), ``speed_scale`` the share of the robot's speed, ``expectations``
    required positions at the start. A motion that is ``tied_to_lease`` stops when the lease ends. ``facts`` are further
    values to report, by name (SI). ``computing_ns`` is the time that the plan took. It begins before
    ``until_ns`` of the robot's clock, if that is not 0. ``request`` is what was asked for; ``detour`` says why it takes
    another path than the direct one, if it does. ``assumed`` are robots as they would stand at its begin, by name; it
    can be rehearsed then, not started.
    """

    robot: Robot
    motion: Move | Follow | Act
    targets: Mapping[str, float]
    requested_at: RobotTime
    speed_scale: float = 1.0
    expectations: Mapping[str, Expectation] = {}
    tied_to_lease: bool = False
    facts: Mapping[str, float] = {}
    computing_ns: int = 0
    until_ns: int = 0
    request: "ActionRequest | None" = None
    detour: str = ""
    assumed: Mapping[str, Robot] = {}

    def among(self, robots: Iterable[Robot]) -> list[Robot]:
        """Return robots as they stand at its begin."""
        return [self.assumed.get(each.name, each) for each in robots]

    @property
    def moves(self) -> bool:
        """True if it moves the robot."""
        return not isinstance(self.motion, Act) or bool(self.motion.moves)


def slowed(motion: Motion, share: float) -> Motion:
    """Return a drive at a share of its speed, which is among its facts."""
    assert isinstance(motion.motion, Act)
    return replace(motion, motion=motion.motion.slowed(share), facts={**motion.facts, "speedShare": share})


@dataclass(frozen=True)
class Halt:
    """A stop of robots (all for None), or only of ``joints``."""

    robots: tuple[str, ...] | None
    joints: tuple[str, ...] = ()


@dataclass(frozen=True)
class DeferredPlan:
    """A plan that takes milliseconds to compute. ``compute`` runs in a thread and uses immutable data only."""

    compute: Callable[[], Motion]


TIME_TO_LIVE_NS = 2_000_000_000
MAX_TIME_TO_LIVE_NS = 60_000_000_000
"""The longest that a command can have (PROTOCOL.md of the wire)."""
_FRAME_NS = 1_000_000_000  # a stop that is further ahead of the latest frame was another run's, by another clock


def build_command(id: str, motion: Motion, waited_ns: int = 0, *, rehearsal: bool = False) -> Command | Operate:
    """Return the command, with the time of the request, whatever time has passed since.

    The time that the plan took does not count, nor ``waited_ns``, the time spent in collision checks and, for rules and
    missions, in Redis.
    """
    time_to_live_ns = min(TIME_TO_LIVE_NS + motion.computing_ns + waited_ns, MAX_TIME_TO_LIVE_NS)
    if motion.until_ns and not rehearsal:
        time_to_live_ns = max(motion.until_ns - motion.requested_at.seen_ns, 1)
    if isinstance(act := motion.motion, Act):
        return Operate(
            version=COMPONENTS_VERSION,
            id=id,
            incarnation=motion.requested_at.incarnation,
            seen_ns=motion.requested_at.seen_ns,
            time_to_live_ns=time_to_live_ns,
            component=act.component,
            action=act.action,
            property=act.property,
            input=Raw(act.input),
            rehearsal=rehearsal,
            stream=True if act.stream else UNSET,
        )
    return Command(
        version=WIRE_VERSION,
        id=id,
        incarnation=motion.requested_at.incarnation,
        seen_ns=motion.requested_at.seen_ns,
        time_to_live_ns=time_to_live_ns,
        motion=act,
        scale=motion.speed_scale,
        expects=dict(motion.expectations),
        rehearsal=rehearsal,
    )


class Caller(Struct, frozen=True):
    """A caller. ``name`` is displayed; ``lease_token`` proves that it has the control lease.

    ``idempotency_key`` belongs to the request with ``request_digest``. ``body`` is the validated body as N-Triples.
    ``stoppable_robots`` are the robots that it may stop, ``visible_robots`` those that it may know of. ``rule`` is the
    rule, mission or order that acts for its creator, or empty. ``patience_s`` is how long it waits for an answer, if it
    says so. ``identity`` has its rights.
    """

    name: str = ""
    lease_token: str = ""
    idempotency_key: str = ""
    request_digest: str = ""
    body: str = ""
    stoppable_robots: View = ALL
    visible_robots: View = ALL
    rule: str = ""
    patience_s: float | None = None
    identity: Identity = EVERYBODY


def robot_time(robot: Robot | None) -> RobotTime | None:
    """Return the present time of a robot; None if it cannot be commanded now.

    After a stop that is newer than the latest frame it is the time after the stop: the agent refuses motions that were
    requested before it.
    """
    frame = None if robot is None or not robot.online else robot.frame
    if robot is None or frame is None or robot.incarnation is None:
        return None
    seen_ns = frame.monotonic_ns
    if seen_ns <= robot.stopped_ns < seen_ns + _FRAME_NS:
        seen_ns = robot.stopped_ns + 1
    return RobotTime(robot.incarnation, seen_ns)


@dataclass(frozen=True)
class ActionRequest:
    """The request of an action; ``base`` is the base URL of IRIs in the body, without trailing slash.

    ``thing`` is the path of what has the action.
    """

    base: str
    body: Body
    robot: Robot | None = None
    joint: Joint | None = None
    robot_time: RobotTime | None = None
    thing: str = ""
    _parts: dict[str, tuple[str | None, str | None]] = field(default_factory=dict, compare=False)

    @property
    def member_id(self) -> str:
        """The id of the member of a container that has the action."""
        return self.thing.rpartition("/")[2]

    def required_time(self) -> RobotTime:
        """Return the time of the request. Raises Offline if the robot could not be commanded."""
        if self.robot_time is None:
            robot = self.required_robot()
            since = "has not sent a frame yet" if robot.online else "is offline"
            raise Offline(f"Robot {robot.name} {since}; its actions answer again once it is back.")
        return self.robot_time

    def required_robot(self) -> Robot:
        assert self.robot is not None
        return self.robot

    def required_joint(self) -> Joint:
        assert self.joint is not None
        return self.joint

    def model(self) -> RobotModel:
        model = self.required_robot().model
        if model is None:
            raise Offline(f"Robot {self.required_robot().name} has no usable description at present.")
        return model

    def joint_at(self, iri: object) -> Joint:
        """Return the joint that an IRI in the body names, as ensured by the shape."""
        joint, _ = self._part(iri)
        assert joint is not None
        return self.model().joints[joint]

    def link_at(self, iri: object) -> str:
        _, link = self._part(iri)
        assert link is not None
        return link

    def _part(self, iri: object) -> tuple[str | None, str | None]:
        assert isinstance(iri, NamedNode)
        if iri.value not in self._parts:  # a trajectory names the same few joints thousands of times
            local = iri.value.removeprefix(self.base + robot_path(self.required_robot().name))
            self._parts[iri.value] = joint_or_link(local, self.model())
        return self._parts[iri.value]
