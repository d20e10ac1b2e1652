"""The search for the parts of a ROS robot in its graph, without configuration."""

import time
from collections.abc import Callable, Iterable, Sequence
from functools import partial
from typing import Literal

from linked_fleet_agent.components.component import Component
from linked_fleet_agent.components.jogging import NAME as JOGGING
from linked_fleet_agent.robot import Facts
from linked_fleet_agent.robots.ros2 import base, gripper, navigation, states
from linked_fleet_agent.robots.ros2.configuration import Configuration
from linked_fleet_agent.robots.ros2.controllers import FOLLOW, Controllers, find_controllers
from linked_fleet_agent.robots.ros2.definitions import DefinitionError
from linked_fleet_agent.robots.ros2.exposure import Exposed, expose
from linked_fleet_agent.robots.ros2.finding import free_joints, joints_of_controller
from linked_fleet_agent.robots.ros2.following import Following, Mover, Way
from linked_fleet_agent.robots.ros2.goals import ActionClient
from linked_fleet_agent.robots.ros2.graph import Interface, Role
from linked_fleet_agent.robots.ros2.inbox import Inbox
from linked_fleet_agent.robots.ros2.own_graph import OwnGraph
from linked_fleet_agent.robots.ros2.parts import Parts
from linked_fleet_agent.robots.ros2.services import GET_PARAMETERS, NoAnswerError, texts
from linked_fleet_agent.robots.ros2.status import RosStatus
from linked_fleet_agent.urdf import RobotModel
from linked_fleet_agent.wire.components import BASE

BATTERY, DIAGNOSTICS = "sensor_msgs/msg/BatteryState", "diagnostic_msgs/msg/DiagnosticArray"
SAFETY_MODE, NUMBER, TRIGGER = "ur_dashboard_msgs/msg/SafetyMode", "std_msgs/msg/Float64", "std_srvs/srv/Trigger"
FRAMES, CLOCK = "tf2_msgs/msg/TFMessage", "rosgraph_msgs/msg/Clock"
MOST_OF_A_KIND = 8
ANEW_S = 30.0
"""Least time from the start of a run until another one begins because more of the robot was found."""
_TRAJECTORY, _GRIPPER = "/joint_trajectory", "gripper"
_MADE_FROM: frozenset[tuple[Role, str]] = frozenset(
    {
        *(("publisher", type) for type in (BATTERY, DIAGNOSTICS, SAFETY_MODE, base.ODOMETRY)),
        *(("subscription", type) for type in (base.TWIST, base.STAMPED_TWIST)),
        *(
            ("service", f"{type}_SendGoal")
            for type in (gripper.COMMAND, gripper.PARALLEL, navigation.NAVIGATE, navigation.DOCK, FOLLOW)
        ),
    }
)


async def find_parts(
    own: OwnGraph,
    facts: Facts,
    controllers: Controllers,
    configuration: Configuration,
    tolerance: float | None = None,
) -> Parts:
    """Return what the graph offers of one robot, and what a configuration makes of the rest of the graph.

    Goals of controllers have the ``tolerance``, if there is one.
    """
    found = _Search(own, facts, controllers, configuration, tolerance)
    await found.run()
    return found.parts


class _Search:
    """One search, and what is looked at again while the robot runs."""

    def __init__(
        self,
        own: OwnGraph,
        facts: Facts,
        controllers: Controllers,
        configuration: Configuration,
        tolerance: float | None,
    ) -> None:
        self._own, self._facts, self._controllers, self._configuration = own, facts, controllers, configuration
        self._tolerance = tolerance
        self._exposed = Exposed()
        self._missing, self._unanswered = list[str](), list[str]()
        self._made_from, self._before = self._relevant(), frozenset[Interface]()
        self._begun_s = time.monotonic()
        self.parts = Parts(held=dict(controllers.held or {}))

    async def run(self) -> None:
        await self._find_base()
        self._find_states()
        movers = [*await self._find_grippers(), *self._find_navigation(), *await self._expose()]
        self.parts.following = Following(self._ways(), movers)
        self._unanswered = await self.parts.following.probe()
        status = RosStatus(self._say_missing, self._clock, self._bad_messages, self.look)
        self.parts.components.append(status)

    async def look(self) -> None:
        """Look at what changes slowly: controllers, servers that answer or do not, and what has come."""
        await self._look_at_controllers()
        self._unanswered = await self.parts.following.probe()
        relevant = self._relevant()
        come = (relevant & self._before) - self._made_from  # seen twice: the graph may be coming up
        self._before = relevant
        if come:
            self._load_anew(f"{min(each.name for each in come)} has come")
        elif self._exposed.lacks(self._configuration, self._own.graph.offers(), self._own.namespace):
            self._load_anew("more that is exposed has come")

    def _load_anew(self, why: str) -> None:
        """Let the robot be loaded again, but not soon: a node that offers ever more must not keep it from working."""
        if time.monotonic() - self._begun_s >= ANEW_S:
            self.parts.anew = why

    async def _expose(self) -> list[Mover]:
        """Make components of what the configuration names."""
        if not self._configuration:
            return []
        own, model = self._own, RobotModel.for_urdf(self._facts.urdf)
        reserved = [*(each.name for each in self.parts.components), RosStatus.name, JOGGING]
        self._exposed = await expose(
            own.graph, own.types, self._configuration, namespace=own.namespace, links=model.links,
            joints=[joint.name for joint in self._facts.joints], reserved=reserved,
        )  # fmt: skip
        self.parts.components += self._exposed.components
        self._missing += self._exposed.findings
        moved = self._exposed.goals.values()
        return [Mover(each.client, each.task.declared.moves) for each in moved if each.task.declared.moves]

    async def _look_at_controllers(self) -> None:
        if not self._controllers.manager:
            return
        own = self._own
        now = await find_controllers(own.graph, own.types, own.namespace, free_joints(self._facts))
        if now is not None and now.manager:
            self.parts.held.clear()
            self.parts.held.update(now.held or {})
            if set(now.chosen) != set(self._controllers.chosen):
                self._load_anew("its controllers have changed")

    def _relevant(self) -> frozenset[Interface]:
        return frozenset(each for role, type in _MADE_FROM for each in self._own.offered(role, type))

    def _ways(self) -> list[Way]:
        """Return the controllers that offer to follow trajectories."""
        offered = {each.name: each for each in self._clients(FOLLOW)}
        found = list[Way]()
        for each in self._controllers.chosen:
            client = offered.get(f"{each.topic.removesuffix(_TRAJECTORY)}/follow_joint_trajectory")
            if client is not None:
                found.append(Way(client, joints_of_controller(each, self._facts), self._tolerance))
            else:
                self._missing.append(f"{each.topic} offers no FollowJointTrajectory; trajectories go to its topic")
        return found

    async def _find_base(self) -> None:
        odometry = sorted(
            self._own.offered("publisher", base.ODOMETRY), key=lambda each: not each.name.endswith("/odom")
        )
        twists = [*self._velocities(base.STAMPED_TWIST), *self._velocities(base.TWIST)]
        if not (odometry or twists or self._own.offered("service", f"{navigation.NAVIGATE}_SendGoal")):
            return
        inbox = self._own.inbox(odometry[0]) if odometry else None
        root = RobotModel.for_urdf(self._facts.urdf).root
        whereabouts = self.parts.whereabouts = base.Whereabouts(root, inbox, *self._frames())
        if inbox is None:
            self._missing.append("no node publishes odometry (nav_msgs/Odometry): velocities of the base are not known")
        if not twists:
            self._missing.append("no node takes velocities on cmd_vel: the base cannot be driven by hand")
            return
        body = await base.body_of(self._own)
        if body.assumed:
            self._missing.append(f"the base does not state {' and '.join(body.assumed)}: these are assumed")
        self.parts.components.append(base.ros_base(whereabouts, body, *self._own.outlet(twists[0])))

    def _velocities(self, type: str) -> list[Interface]:
        return [each for each in self._own.offered("subscription", type) if each.name.endswith("/cmd_vel")]

    def _frames(self) -> tuple[Inbox, Inbox]:
        own = f"{self._own.namespace}/tf"
        name = own if any(each.name == own for each in self._own.offered("publisher", FRAMES)) else "/tf"
        static = Interface(f"{name}_static", FRAMES)
        return self._own.inbox(Interface(name, FRAMES)), self._own.inbox(static, latched=True)

    def _find_states(self) -> None:
        batteries = self._own.offered("publisher", BATTERY)[:MOST_OF_A_KIND]
        for each in batteries:
            self._add(partial(self._battery, self._own.name("battery", each, batteries), each))
        diagnostics = self._own.offered("publisher", DIAGNOSTICS, everywhere=True)
        for each in sorted(diagnostics, key=lambda each: not each.name.endswith("_agg"))[:1]:
            self._add(partial(self._diagnostics, each))
        safety = self._own.offered("publisher", SAFETY_MODE)
        scaling = [each for each in self._own.offered("publisher", NUMBER) if each.name.endswith("/speed_scaling")]
        if safety or scaling:
            self._add(lambda: self._mode(safety, scaling))

    def _battery(self, name: str, topic: Interface) -> Component:
        return states.RosBattery(name, self._own.inbox(topic))

    def _diagnostics(self, topic: Interface) -> Component:
        return states.RosDiagnostics("diagnostics", self._own.inbox(topic))

    def _mode(self, safety: Sequence[Interface], scaling: Sequence[Interface]) -> Component:
        ends = [each for each in self._own.offered("service", TRIGGER) if each.name.endswith("/unlock_protective_stop")]
        stops = self._own.inbox(safety[0], latched=True) if safety else None
        speed = self._own.inbox(scaling[0]) if scaling else None
        return states.RosMode(stops, speed, partial(self._end_stop, ends[0]) if ends else None)

    async def _end_stop(self, service: Interface) -> None:
        try:
            answer = await self._own.ask(service, {})
        except NoAnswerError as error:
            raise ValueError(str(error)) from error
        if not answer["success"]:
            raise ValueError(f"the robot does not end it: {answer['message'][:300]}")

    async def _find_grippers(self) -> list[Mover]:
        clients = [*self._clients(gripper.COMMAND), *self._clients(gripper.PARALLEL)][:MOST_OF_A_KIND]
        movers = list[Mover]()
        joints = {joint.name: joint for joint in self._facts.joints}
        for client in clients:
            node = client.name.rpartition("/")[0]
            moved = await self._joint_of(node)
            if moved not in joints:
                who = node or "its node"
                self._missing.append(
                    f"{client.name} moves a gripper, but {who} does not say which joint; it is left out"
                )
                continue
            claw = gripper.Claw(client, joints[moved], partial(self._position, moved))
            name = self._own.name("gripper", Interface(node, ""), clients)
            self._add(partial(gripper.gripper_of, claw, name))
            movers.append(Mover(client, (moved,)))
        return movers

    async def _joint_of(self, node: str) -> str:
        """Return the joint of the controller of a gripper: as its manager lists it, or by its parameters.

        An action may stand beside its node, as that of Franka's gripper does: then a node there with such a name is
        asked too.
        """
        listed = [each for each in self._controllers.listed if f"{self._own.namespace}/{each.name}" == node]
        if listed and listed[0].joints:
            return listed[0].joints[0]
        stated = [await self._stated_joint(each) for each in (node, *self._grippers_beside(node))]
        found = list(dict.fromkeys(filter(None, stated)))
        return stated[0] or (found[0] if len(found) == 1 else "")

    def _grippers_beside(self, path: str) -> list[str]:
        """Return the nodes directly below a path that are called after a gripper."""
        services = (each.name for each in self._own.offered("service", GET_PARAMETERS))
        nodes = (each.rpartition("/")[0] for each in services)
        beside = sorted({each for each in nodes if each.rpartition("/")[0] == path and _GRIPPER in each})
        return beside[:MOST_OF_A_KIND]

    async def _stated_joint(self, node: str) -> str:
        said = await self._own.parameters(node, ("joint", "joints", "joint_names"))
        several = texts(said.get("joints")) or texts(said.get("joint_names"))
        return str(said.get("joint") or next(iter(several), ""))

    def _position(self, joint: str) -> float:
        return self.parts.position(joint)

    def _find_navigation(self) -> list[Mover]:
        drives = [each for type in navigation.ACTIONS for each in self._clients(type)]
        by_type = {each.type_name: each for each in reversed(drives)}
        if (navigate := by_type.get(navigation.NAVIGATE)) is None:
            return []
        dock, undock = by_type.get(navigation.DOCK), by_type.get(navigation.UNDOCK)
        self._add(lambda: navigation.navigation_of(self.parts.whereabouts, navigate, dock, undock))
        return [Mover(each, (BASE,)) for each in drives]

    def _clients(self, type: str) -> list[ActionClient]:
        try:
            return self._own.actions(type)
        except DefinitionError as error:
            self._missing.append(f"actions of {type} are left out: {error}")
            return []

    def _add(self, make: Callable[[], Component]) -> None:
        """Add a component, or say why it cannot be one."""
        try:
            self.parts.components.append(make())
        except DefinitionError as error:
            self._missing.append(f"a component is left out: {error}")

    def _say_missing(self) -> Iterable[str]:
        held = (f"{joint}: {why}" for joint, why in self.parts.held.items())
        return [*self._missing, *self._unanswered, *held, *filter(None, [self.parts.stamps])]

    def _clock(self) -> Literal["system", "simulated"]:
        return "simulated" if self._own.offered("publisher", CLOCK, everywhere=True) else "system"

    def _bad_messages(self) -> int:
        return self.parts.bad_states() + sum(each.bad_messages for each in self._own.inboxes)
