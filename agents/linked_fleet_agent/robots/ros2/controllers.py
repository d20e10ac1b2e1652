"""The trajectory controllers of a robot: which there are, which joints they have, and whether they are active.

What ros2_control lists decides (controller_manager_msgs/ListControllers). Without its manager, each controller that
takes trajectories is asked for its parameter ``joints``.
"""

import asyncio
from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

from linked_fleet_agent.robots.ros2.address import Controller
from linked_fleet_agent.robots.ros2.graph import Graph, Offer
from linked_fleet_agent.robots.ros2.services import NoAnswerError, ask, parameters_of, texts
from linked_fleet_agent.robots.ros2.types import MessageTypes

LIST_CONTROLLERS = "controller_manager_msgs/srv/ListControllers"
TRAJECTORY, FOLLOW = "trajectory_msgs/msg/JointTrajectory", "control_msgs/action/FollowJointTrajectory"
_TOPIC, _ACTION = "/joint_trajectory", "/follow_joint_trajectory"


class Stated(NamedTuple):
    """A controller as its manager lists it. ``joints`` are those that it commands, or would if it were active."""

    name: str
    state: str
    joints: tuple[str, ...]

    @property
    def is_active(self) -> bool:
        return self.state == "active"


@dataclass(frozen=True)
class Controllers:
    """The controllers that a robot is driven by, and why joints take no commands now, by joint.

    ``listed`` are all that a manager has listed, those of grippers included; none without a manager.
    """

    chosen: tuple[Controller, ...] = ()
    held: dict[str, str] | None = None
    listed: tuple[Stated, ...] = ()

    @property
    def manager(self) -> bool:
        """True if a manager lists them."""
        return bool(self.listed)


def takes_trajectories(offers: Collection[Offer], namespace: str) -> list[str]:
    """Return the nodes below ``namespace`` that take trajectories, by a topic or an action."""
    found = dict[str, None]()
    for each in offers:
        name, type = each.interface.name, each.interface.type
        if each.role == "subscription" and type == TRAJECTORY and name.endswith(_TOPIC):
            found[name.removesuffix(_TOPIC)] = None
        elif each.role == "service" and type == f"{FOLLOW}_SendGoal":
            found[name.removesuffix(f"{_ACTION}/_action/send_goal")] = None
    return [each for each in found if each.startswith(f"{namespace}/")]


async def find_controllers(
    graph: Graph, types: MessageTypes, namespace: str, joints: Collection[str]
) -> Controllers | None:
    """Return the controllers of these ``joints``, or None if nobody says which they are."""
    manager = f"{namespace}/controller_manager/list_controllers"
    nodes = takes_trajectories(graph.offers(), namespace)
    if any(each.role == "service" and each.interface.name == manager for each in graph.offers()):
        try:
            listed = stated(await ask(graph, types, manager, LIST_CONTROLLERS, {}))
        except NoAnswerError:
            listed = ()
        if listed:
            return choose(listed, nodes, namespace, joints)
    asked = await asyncio.gather(*(_joints_of(graph, types, node) for node in nodes))
    chosen = _disjoint(
        [Stated(node.removeprefix(f"{namespace}/"), "active", found) for node, found in zip(nodes, asked, strict=True)],
        joints,
    )
    return Controllers(tuple(_controller(namespace, each) for each in chosen)) if chosen else None


def stated(answer: dict[str, Any]) -> tuple[Stated, ...]:
    """Return what a controller manager lists."""
    return tuple(
        Stated(
            each["name"], each["state"], _joints([*each["required_command_interfaces"], *each["claimed_interfaces"]])
        )
        for each in answer["controller"]
    )


def choose(listed: Sequence[Stated], nodes: Collection[str], namespace: str, joints: Collection[str]) -> Controllers:
    """Return the controllers to drive the robot by: active ones first, and each joint by one of them."""
    able = [each for each in listed if f"{namespace}/{each.name}" in nodes]
    chosen = _disjoint(sorted(able, key=lambda each: not each.is_active), joints)
    held = {joint: f"{each.name} is {each.state}" for each in chosen if not each.is_active for joint in each.joints}
    return Controllers(tuple(_controller(namespace, each) for each in chosen), held, tuple(listed))


def _disjoint(found: Iterable[Stated], joints: Collection[str]) -> list[Stated]:
    """Return those whose joints are all of the robot, and of none before."""
    chosen, free = list[Stated](), set(joints)
    for each in found:
        if each.joints and free.issuperset(each.joints):
            chosen.append(each)
            free -= set(each.joints)
    return chosen


async def _joints_of(graph: Graph, types: MessageTypes, node: str) -> tuple[str, ...]:
    """Return the parameter ``joints`` of a controller's node; nothing if it does not say."""
    return texts((await parameters_of(graph, types, node, ("joints",))).get("joints"))


def _joints(interfaces: Iterable[str]) -> tuple[str, ...]:
    """Return the joints of command interfaces such as ``elbow/position``, ``elbow/velocity`` or ``elbow/effort``."""
    return tuple(dict.fromkeys(each.rpartition("/")[0] for each in interfaces))


def _controller(namespace: str, each: Stated) -> Controller:
    return Controller(f"{namespace}/{each.name}{_TOPIC}", each.joints)
