"""A ROS 2 robot over Zenoh, by rmw_zenoh or zenoh-bridge-ros2dds, without a ROS installation (extra: ros)."""

import asyncio
import logging
import math
import time
from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace

from linked_fleet_agent.components.component import Component
from linked_fleet_agent.mesh_files import NO_ROOTS, MeshRoots
from linked_fleet_agent.robot import Facts, FollowedEnd, NewDescriptionError, Reading, RobotFaultError
from linked_fleet_agent.robots.ros2 import cdr
from linked_fleet_agent.robots.ros2.address import Address
from linked_fleet_agent.robots.ros2.configuration import read_configuration
from linked_fleet_agent.robots.ros2.controllers import Controllers
from linked_fleet_agent.robots.ros2.finding import (
    controllers_of,
    described,
    joints_of_controller,
    listen_to_descriptions,
    open_session,
    settled,
    types_of,
    usual_controllers,
    with_controllers,
    with_meshes,
)
from linked_fleet_agent.robots.ros2.graph import Graph, Interface, Mailbox, Outlet
from linked_fleet_agent.robots.ros2.inbox import TypedInbox
from linked_fleet_agent.robots.ros2.joints import JointStates, TrajectoryPoints, time_from_start_s
from linked_fleet_agent.robots.ros2.new_descriptions import NewDescriptions
from linked_fleet_agent.robots.ros2.own_graph import OwnGraph
from linked_fleet_agent.robots.ros2.parts import Parts
from linked_fleet_agent.robots.ros2.search import find_parts
from linked_fleet_agent.robots.ros2.stamps import Stamps
from linked_fleet_agent.robots.ros2.state_layouts import JointStateReader
from linked_fleet_agent.robots.ros2.types import MessageTypes
from linked_fleet_agent.sensors import JointSensor
from linked_fleet_agent.trajectory import Trajectory
from linked_fleet_agent.urdf import RobotModel
from linked_fleet_agent.wire.components import BASE

_log = logging.getLogger(__name__)

TIMEOUT_S = 5.0
"""Longest wait of one attempt to find a robot."""
_SETTLE_S = 2.0
_LOOK_S = 0.02
_MOST_PUBLISHERS = 16
MOST_STATE_BYTES_S = 2_097_152
"""Bytes of joint states that are decoded in a second: those of 40 joints at 1 kHz."""
_RESTING_S = 3.0
"""A robot that was not commanded for this time may be loaded anew when more of it is found."""


class Ros2Robot:
    """Driver of a robot whose description, joint states and controllers are on topics, services and actions of ROS."""

    def __init__(
        self,
        name: str,
        address: Address,
        facts: Facts,
        graph: Graph,
        descriptions: Mailbox,
        controllers: Controllers | None = None,
        parts: Parts | None = None,
    ) -> None:
        controllers = controllers or usual_controllers(address)
        self._name, self._graph, self._address = name, graph, address
        self._facts = with_controllers(facts, controllers.chosen, address.tolerance)
        self._parts = parts or Parts()
        if self._parts.whereabouts is not None:
            self._facts = replace(self._facts, floating=True)
        self._descriptions = NewDescriptions(name, facts, descriptions)
        self._limits = {joint.name: joint.limits for joint in self._facts.joints}
        joints = RobotModel.for_urdf(facts.urdf).joints
        mimics = {joint.name: joint.mimic for joint in joints.values() if joint.mimic is not None}
        self._states = JointStates(name, self._facts.joints, address.states, address.stale_s, mimics)
        self._inbox = TypedInbox(
            graph, address.states, JointStateReader(), longest=cdr.MAX_STATE_BYTES, most_bytes_s=MOST_STATE_BYTES_S
        )
        self._ways = [
            (TrajectoryPoints(each.topic, joints_of_controller(each, self._facts)), self._outlet(each.topic))
            for each in controllers.chosen
        ]
        self._parts.position = lambda joint: self._states.position(joint, time.monotonic())
        self._parts.bad_states = lambda: self.bad_messages
        self._last_known = dict[str, float]()
        self._stamps = dict[tuple[str, ...], Stamps]()
        self._read_s = self._cycle_s = 0.0
        self._commanded_s = -math.inf

    @classmethod
    def find(
        cls, name: str, address: Address, timeout_s: float = TIMEOUT_S, roots: MeshRoots = NO_ROOTS
    ) -> "Ros2Robot":
        """Connect to the robot at ``address``: wait for its description, and briefly for joint states and controllers.

        Its meshes are in the folders of the address, and in ``roots``.

        Raises ConnectionError if the endpoint does not answer within ``timeout_s``, TimeoutError if no description
        arrives, AddressError if a controller names joints that the robot does not have.
        """
        return asyncio.run(cls._find(name, address, timeout_s, roots))

    @classmethod
    async def _find(cls, name: str, address: Address, timeout_s: float, roots: MeshRoots) -> "Ros2Robot":
        deadline_s = time.monotonic() + timeout_s
        types = types_of(address)
        graph = await open_session(name, address, types.hash_of, deadline_s)
        try:
            return await cls.join(name, address, graph, types, deadline_s, roots)
        except BaseException:
            graph.close()
            raise

    @classmethod
    async def join(
        cls,
        name: str,
        address: Address,
        graph: Graph,
        types: MessageTypes | None = None,
        deadline_s: float = math.inf,
        roots: MeshRoots = NO_ROOTS,
    ) -> "Ros2Robot":
        """Find the robot in a graph. Raises TimeoutError, AddressError."""
        types = types or types_of(address)
        configuration = read_configuration(address.config, address.namespace, address.expose, address.deny)
        descriptions = listen_to_descriptions(graph, address)
        facts = with_meshes(name, await described(name, address, graph, descriptions, deadline_s), address, roots)
        await settled(graph)
        controllers = await controllers_of(graph, types, address, facts)
        own = OwnGraph(graph, types, address.namespace)
        parts = await find_parts(own, facts, controllers, configuration, address.tolerance)
        robot = cls(name, address, facts, graph, descriptions, controllers, parts)
        await robot.wait_for_peers()
        return robot

    async def wait_for_peers(self) -> None:
        """Wait up to ``_SETTLE_S`` for a first joint state and for the controllers to listen; log what is missing."""
        deadline_s = time.monotonic() + _SETTLE_S
        while missing := self._missing():
            if time.monotonic() > deadline_s:
                _log.warning("%s: not there yet: %s", self._name, ", ".join(missing))
                return
            await asyncio.sleep(_LOOK_S)

    def describe(self) -> Facts:
        return self._facts

    def components(self) -> Sequence[Component]:
        return self._parts.components

    def read(self, now_s: float) -> Reading:
        """Return the last joint states, by arrival time.

        Raises RobotFaultError if none arrived recently or the last description is refused, NewDescriptionError if a
        different one has arrived, or more of the robot was found while it rests.
        """
        self._descriptions.check()
        here_s = time.monotonic()
        self._cycle_s, self._read_s = here_s - self._read_s, here_s
        if self._parts.anew and here_s - self._commanded_s > _RESTING_S and not self._parts.is_busy:
            raise NewDescriptionError(self._parts.anew)
        for said, arrived_s in self._inbox.arrivals():
            self._states.update(said, arrived_s)
            self._note_stamp(said.names, said.stamp_ns, arrived_s)
        reading = self._states.reading(here_s)
        if self._parts.whereabouts is not None:
            self._parts.whereabouts.update()
            reading = reading._replace(base=self._parts.whereabouts.reading(here_s))
        return reading._replace(held=self._parts.held) if self._parts.held else reading

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
        self._commanded_s = now_s
        for follower, outlet in self._ways:
            if not applied.keys().isdisjoint(follower.joints):
                self._send(follower, outlet, follower.next(applied, now_s))
        return applied

    def stop(self) -> None:
        """Send every controller the present positions of its joints, and cancel what they follow.

        Raises RobotFaultError if one cannot be reached.
        """
        now_s, measured = time.monotonic(), self._measured()
        self._parts.end_others([*self._limits, BASE])
        problems = []
        for follower, outlet in self._ways:
            try:
                self._send(follower, outlet, follower.hold(measured, now_s))
            except RobotFaultError as error:
                problems.append(str(error))
        if problems:
            raise RobotFaultError("; ".join(problems))

    def follow(self, id: str, trajectories: Mapping[str, Trajectory]) -> bool:
        self._commanded_s = time.monotonic()
        return self._parts.following.follow(id, trajectories)

    def leave(self, id: str) -> None:
        self._parts.following.leave(id)

    def ended(self) -> Sequence[FollowedEnd]:
        return self._parts.following.ended()

    def end_others(self, joints: Collection[str]) -> None:
        self._parts.end_others(joints)

    @property
    def sensors(self) -> Mapping[str, JointSensor]:
        return self._states.sensors

    @property
    def ended_others(self) -> str:
        return self._parts.following.ended_others

    @property
    def bad_messages(self) -> int:
        """Joint states and descriptions that could not be read."""
        return self._inbox.bad_messages + self._descriptions.bad_messages

    def close(self) -> None:
        self._graph.close()

    def _outlet(self, topic: str) -> Outlet:
        return self._graph.outlet(Interface(topic, cdr.JOINT_TRAJECTORY))

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

    def _note_stamp(self, joints: tuple[str, ...], stamp_ns: int, arrived_s: float) -> None:
        """Say once what is wrong with time stamps. Publishers are told apart by their joints."""
        stamps = self._stamps.get(joints)
        if stamps is None and len(self._stamps) < _MOST_PUBLISHERS:
            stamps = self._stamps[joints] = Stamps()
        if stamps is not None and not stamps.finding:
            stamps.update(stamp_ns, arrived_s, time.time_ns())
            if stamps.finding and not self._parts.stamps:
                self._parts.stamps = f"messages of {self._address.states} {stamps.finding}; times of arrival count"
                _log.warning("%s: %s", self._name, self._parts.stamps)
