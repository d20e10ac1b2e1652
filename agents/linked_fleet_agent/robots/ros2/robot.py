"""A ROS 2 robot over Zenoh, by rmw_zenoh or zenoh-bridge-ros2dds, without a ROS installation (extra: ros)."""

import logging
import math
import time
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

from linked_fleet_agent.mesh_files import NO_ROOTS, MeshRoots, mesh_files
from linked_fleet_agent.robot import Facts, JointFacts, NewDescriptionError, Reading, RobotFaultError
from linked_fleet_agent.robots.ros2 import cdr
from linked_fleet_agent.robots.ros2.address import Address, AddressError, Controller
from linked_fleet_agent.robots.ros2.graph import Graph, Interface, Mailbox, Outlet, ReceivedMessage
from linked_fleet_agent.robots.ros2.joints import JointStates, TrajectoryPoints, time_from_start_s
from linked_fleet_agent.robots.ros2.session import RosSession
from linked_fleet_agent.urdf import RobotModel, UrdfError, joints_of

_log = logging.getLogger(__name__)

TIMEOUT_S = 5.0
"""Longest wait of one attempt to find a robot."""
_SETTLE_S = 2.0
_LOOK_S = 0.02
_LONGEST_TITLE = 256
_NODE, _BRIDGE = "linked_fleet_agent", "zenoh-bridge-ros2dds"


class Ros2Robot:
    """Driver over three topics: it reads ``/robot_description`` and ``/joint_states`` and sends ``JointTrajectory``."""

    def __init__(self, name: str, address: Address, facts: Facts, session: Graph, descriptions: Mailbox) -> None:
        coupled = tuple(tuple(_joints_of(one, facts.joints)) for one in address.controllers)
        joints = tuple(replace(joint, tolerance=address.tolerance) for joint in facts.joints)
        self._name, self._facts, self._session = name, replace(facts, joints=joints, coupled=coupled), session
        self._descriptions, self._refused = descriptions, ""
        self._limits = {joint.name: joint.limits for joint in facts.joints}
        self._states = JointStates(name, facts.joints, address.states, address.stale_s)
        self._inbox = session.subscribe(Interface(address.states, cdr.JOINT_STATE), cdr.MAX_STATE_BYTES)
        self._ways = [
            (
                TrajectoryPoints(one.topic, _joints_of(one, facts.joints)),
                session.outlet(Interface(one.topic, cdr.JOINT_TRAJECTORY)),
            )
            for one in address.controllers
        ]
        self._last_known = dict[str, float]()
        self.bad_messages = 0
        self._read_s = self._cycle_s = 0.0

    @classmethod
    def find(
        cls, name: str, address: Address, timeout_s: float = TIMEOUT_S, roots: MeshRoots = NO_ROOTS
    ) -> "Ros2Robot":
        """Connect to the robot at ``address``: wait for its description, and briefly for joint states and controllers.

        Its meshes are in the folders of the address, and in ``roots``.

        Raises ConnectionError if the endpoint does not answer within ``timeout_s``, TimeoutError if no description
        arrives, AddressError if a controller names joints that the robot does not have.
        """
        deadline_s = time.monotonic() + timeout_s
        session = _opened(name, address, deadline_s)
        try:
            topic = Interface(address.description, cdr.STRING)
            descriptions = session.subscribe(topic, cdr.MAX_TEXT_BYTES, most=2, latched=True)
            facts = _described(name, address, session, descriptions, deadline_s)
            facts = with_meshes(name, facts, address, roots)
            robot = cls(name, address, facts, session, descriptions)
            robot.wait_for_peers()
        except BaseException:
            session.close()
            raise
        return robot

    def wait_for_peers(self) -> None:
        """Wait up to ``_SETTLE_S`` for a first joint state and for the controllers to listen; log what is missing."""
        deadline_s = time.monotonic() + _SETTLE_S
        while missing := self._missing():
            if time.monotonic() > deadline_s:
                _log.warning("%s: not there yet: %s", self._name, ", ".join(missing))
                return
            time.sleep(_LOOK_S)

    def describe(self) -> Facts:
        return self._facts

    def read(self, now_s: float) -> Reading:
        """Return the last joint states, by arrival time.

        Raises RobotFaultError if none arrived recently or the last description is refused, NewDescriptionError if a
        different one has arrived.
        """
        self._check_descriptions()
        here_s = time.monotonic()
        self._cycle_s, self._read_s = here_s - self._read_s, here_s
        for arrived in self._inbox.fetch():
            self._take(arrived)
        return self._states.reading(here_s)

    def apply(self, setpoints: Mapping[str, float]) -> dict[str, float]:
        """Send each affected controller its next point, with the setpoints of all its joints.

        Raises KeyError for a joint without a controller, ValueError for a setpoint that is not finite, RobotFaultError
        if a controller does not listen.
        """
        now_s, measured = time.monotonic(), self._measured()
        applied = {name: self._clamped(name, setpoint, measured[name]) for name, setpoint in setpoints.items()}
        for name, setpoint in applied.items():
            if not math.isfinite(setpoint):
                raise ValueError(f"setpoint {setpoint} of joint {name!r} is not finite")
        stray = applied.keys() - {name for follower, _ in self._ways for name in follower.joints}
        if stray:
            raise KeyError(f"no controller has {', '.join(sorted(stray))}")
        for follower, outlet in self._ways:
            if not applied.keys().isdisjoint(follower.joints):
                self._send(follower, outlet, follower.next(applied, now_s))
        return applied

    def stop(self) -> None:
        """Send every controller the present positions of its joints.

        Raises RobotFaultError if one cannot be reached.
        """
        now_s, measured = time.monotonic(), self._measured()
        problems = []
        for follower, outlet in self._ways:
            try:
                self._send(follower, outlet, follower.hold(measured, now_s))
            except RobotFaultError as error:
                problems.append(str(error))
        if problems:
            raise RobotFaultError("; ".join(problems))

    def close(self) -> None:
        self._session.close()

    def _missing(self) -> list[str]:
        try:
            self.read(0.0)
            missing = []
        except RobotFaultError as error:
            missing = [str(error)]
        return missing + [
            f"no controller listens to {follower.topic}" for follower, out in self._ways if not out.has_subscribers
        ]

    def _send(self, follower: TrajectoryPoints, outlet: Outlet, positions: Mapping[str, float]) -> None:
        if not outlet.has_subscribers:
            raise RobotFaultError(f"no controller listens to {follower.topic}")
        if not positions:
            raise RobotFaultError(
                f"no joint position of {follower.topic} is known; its controller holds the last position that "
                "it was sent"
            )
        outlet.put(cdr.write_trajectory(list(positions), list(positions.values()), time_from_start_s(self._cycle_s)))

    def _clamped(self, name: str, setpoint: float, measured: float) -> float:
        """Return the setpoint within the limits, or as far out as the joint is.

        While the position is unknown, the last known one counts; without any, the limits alone.
        """
        known = self._last_known.get(name, math.nan) if math.isnan(measured) else measured
        return self._limits[name].including(known).clamp(setpoint)

    def _measured(self) -> dict[str, float]:
        now_s = time.monotonic()
        measured = {name: self._states.position(name, now_s) for name in self._limits}
        self._last_known.update({name: at for name, at in measured.items() if not math.isnan(at)})
        return measured

    def _check_descriptions(self) -> None:
        for arrived in self._descriptions.fetch():
            try:
                said = facts_of(self._name, arrived)
            except cdr.CdrError as error:
                _log.warning("%s: a message that is no description is ignored: %s", self._name, error)
                continue
            except UrdfError as error:
                self._refused = f"the robot sent a new description, which is refused: {error}"
                continue
            self._refused = ""
            if said.urdf != self._facts.urdf:
                raise NewDescriptionError("the robot sent a new description")
        if self._refused:
            raise RobotFaultError(self._refused)

    def _take(self, arrived: ReceivedMessage) -> None:
        try:
            if arrived.payload is None:
                raise cdr.CdrError("it is too long")
            self._states.update(cdr.read_joint_state(arrived.payload), arrived.at_s)
        except cdr.CdrError as error:
            self.bad_messages += 1
            # logs the 1st, 2nd, 4th … message, so that a flood does not fill the log
            if self.bad_messages.bit_count() == 1:
                _log.warning("%s: bad joint state (%d so far): %.200s", self._name, self.bad_messages, error)


def _outlet(session: Graph, controller: Controller) -> Outlet:
    return session.outlet(Interface(controller.topic, cdr.JOINT_TRAJECTORY))


def _joints_of(controller: Controller, joints: Iterable[JointFacts]) -> Sequence[str]:
    return controller.joints or [joint.name for joint in joints if joint.mimics is None]


def _opened(name: str, address: Address, deadline_s: float) -> RosSession:
    _log.info("%s: waiting for %s at %s", name, address.description, address.endpoint)
    while True:
        try:
            return RosSession(address.endpoint, address.domain, _NODE, cdr.type_hash, address.bridge_only)
        except ConnectionError:
            if time.monotonic() > deadline_s:
                raise
            time.sleep(_LOOK_S)


def _described(name: str, address: Address, session: RosSession, box: Mailbox, deadline_s: float) -> Facts:
    """Return the facts of the first valid description. Raises TimeoutError with the reason of the last refusal."""
    refused = ""
    while time.monotonic() < deadline_s:
        for arrived in box.fetch():
            try:
                return _with_controllers(facts_of(name, arrived), address.controllers)
            except (cdr.CdrError, UrdfError) as error:
                refused = f": the last one is refused: {error}"
                _log.warning("%s: bad description: %s", name, error)
        time.sleep(_LOOK_S)
    by = f"by {_BRIDGE}" if address.bridge_only else f"in domain {address.domain} of rmw_zenoh"
    by += f" or by {_BRIDGE}" if session.is_bridged and not address.bridge_only else ""
    met = "" if session.offers() else "; no node of ROS was met there"
    raise TimeoutError(f"no usable robot description came on {address.description} {by}{met}{refused}")


def facts_of(name: str, arrived: ReceivedMessage) -> Facts:
    """Parse a description. Raises CdrError or UrdfError if it is not that of a robot with joints."""
    if arrived.payload is None:
        raise cdr.CdrError("it is too long")
    urdf = cdr.read_string(arrived.payload)
    joints = joints_of(urdf)
    names = {joint.name for joint in joints}
    if not 0 < len(names) == len(joints) <= cdr.MAX_JOINTS:
        raise UrdfError(f"{len(joints)} joints with {len(names)} different names are not the joints of a robot")
    return Facts(RobotModel.for_urdf(urdf).name[:_LONGEST_TITLE], urdf, joints)


def with_meshes(name: str, facts: Facts, address: Address, roots: MeshRoots) -> Facts:
    """Return the facts with the meshes in the folders of the address and in ``roots``."""
    all_roots = MeshRoots((*address.meshes, *roots.folders), roots.prefixes)
    return replace(facts, meshes=mesh_files(facts.urdf, None, all_roots, name))


def _with_controllers(facts: Facts, controllers: Sequence[Controller]) -> Facts:
    """Return the facts with joints outside all controllers marked as passive."""
    free = {joint.name for joint in facts.joints if joint.mimics is None}
    for controller in controllers:
        missing = [joint for joint in controller.joints if joint not in free]
        if missing:
            raise AddressError(f"{controller.topic} is configured for {', '.join(missing)}, which take no commands")
    if not any(controller.joints for controller in controllers):
        return facts
    led = {joint for controller in controllers for joint in controller.joints}
    joints = (joint if joint.name in led or joint.mimics else replace(joint, passive=True) for joint in facts.joints)
    return replace(facts, joints=tuple(joints))
