"""A copy of the fleet in the query process, rebuilt from messages of the gateway (``messages.News``)."""

import logging
from pkgutil import resolve_name

import msgspec

from linked_fleet_agent.wire.codec import encode_state, read_header
from linked_fleet_gateway.extensions.query.messages import HypotheticalRobot, Member, News, RobotFacts
from linked_fleet_gateway.faces import PartCopier
from linked_fleet_state.events import Frames
from linked_fleet_state.invocation import Invocation
from linked_fleet_state.robot import Robot

log = logging.getLogger(__name__)


class MirroredRobot:
    """One robot with its invocations.

    ``said`` counts changes without a frame, ``seen`` its frames, ``valued`` changes of values of parts.
    """

    def __init__(self, robot: Robot) -> None:
        self.robot = robot
        self.branches: list[Member] = []
        self.invocations: list[Invocation] = []
        self.copier_name = ""
        self.copier: type[PartCopier] | None = None
        self.said = self.seen = self.valued = 0

    @property
    def tasks(self) -> list[Invocation]:
        """Its running invocations."""
        return [each for each in self.invocations if not each.state.terminal]


class Mirror:
    """All robots by name."""

    def __init__(self) -> None:
        self.robots: dict[str, MirroredRobot] = {}
        self._frames = Frames()

    def update(self, news: News) -> None:
        """Update the copy to the snapshot in ``news``."""
        for said in news.robots:
            held = self.robots.get(said.name)
            if held is None:
                held = self.robots[said.name] = MirroredRobot(Robot(said.name, _log_error, self._frames))
            _tell(held, said)
        for name in news.forgotten:
            self.robots.pop(name, None)
        for name, frame in news.frames.items():
            _show(self.robots[name], frame)
        for name, values in news.values.items():
            _give(self.robots[name], values)

    def assume(self, instead: HypotheticalRobot) -> None:
        """Replace a robot's state by a hypothetical one; only for a forked copy that gets no further news."""
        held = self.robots.get(instead.robot)
        if held is None:
            return
        robot, state = held.robot, held.robot.frame
        if state is not None and robot.description is not None:
            measured = zip(state.positions, state.velocities, state.efforts, strict=True)
            by_joint = dict(zip(robot.description.joints, measured, strict=True))
            by_joint |= {name: values for name, values in instead.joints.items() if name in by_joint}
            positions, velocities, efforts = zip(*by_joint.values(), strict=True) if by_joint else ((), (), ())
            state = msgspec.structs.replace(state, positions=positions, velocities=velocities, efforts=efforts)
            _show(held, encode_state(state))
        targets: dict[str, float | None] = {**robot.targets, **instead.targets}
        robot.targets = {name: target for name, target in targets.items() if target is not None}
        supposed = [instead.motions.get(each.id, each) for each in held.invocations]
        held.invocations = [each for each in supposed if each is not None]
        held.said += 1


def _tell(held: MirroredRobot, said: RobotFacts) -> None:
    robot, described = held.robot, held.robot.description
    if said.incarnation is not None and said.incarnation != robot.incarnation:
        robot.start_run(said.incarnation)
    if said.description is None:
        if said.fault is not None:
            robot.reject_description(said.fault)
    elif said.description != robot.description:
        robot.describe(said.description)
    if said.copier != held.copier_name or robot.description is not described:
        _make_parts(held, said.copier)
    robot.findings, robot.kept_poses = said.findings, said.kept_poses
    robot.online, robot.heard_ns, robot.lease = said.online, said.last_seen_ns, said.lease
    robot.limit_fault, robot.unchecked = said.limit_fault, said.unchecked
    robot.agent_fault, robot.sensor_faults = said.agent_fault, said.sensor_faults
    robot.settings, robot.targets = said.settings, said.targets
    held.branches, held.invocations = said.branches, said.invocations
    held.said += 1


def _make_parts(held: MirroredRobot, copier: str) -> None:
    held.copier_name = copier
    held.copier = resolve_name(copier) if copier else None
    held.robot.parts = {} if held.copier is None else held.copier.make(held.robot)


def _give(held: MirroredRobot, values: bytes) -> None:
    assert held.copier is not None
    held.copier.read(held.robot, values)
    held.valued += 1


def _show(held: MirroredRobot, frame: bytes | None) -> None:
    held.seen += 1
    if frame is None:
        held.robot.drop_frame()
    else:
        held.robot.store_frame(read_header(frame), frame, 0)


def _log_error(robot: str, what: object) -> None:
    log.warning("robot %s: %s", robot, what)
