"""The search for the robot at an address: its session, its description, and what its controllers are."""

import asyncio
import logging
import time
from collections.abc import Callable, Sequence
from dataclasses import replace

from linked_fleet_agent.mesh_files import MeshRoots, mesh_files
from linked_fleet_agent.robot import Facts
from linked_fleet_agent.robots.ros2 import cdr
from linked_fleet_agent.robots.ros2.address import Address, AddressError, Controller
from linked_fleet_agent.robots.ros2.controllers import Controllers, find_controllers, takes_trajectories
from linked_fleet_agent.robots.ros2.definitions import DefinitionError
from linked_fleet_agent.robots.ros2.graph import Graph, Interface, Mailbox, ReceivedMessage
from linked_fleet_agent.robots.ros2.session import RosSession
from linked_fleet_agent.robots.ros2.types import MessageTypes
from linked_fleet_agent.urdf import RobotModel, UrdfError, joints_of

_log = logging.getLogger(__name__)

_LOOK_S = 0.02
_QUIET_S, _SETTLE_S = 0.3, 2.0
"""The graph is known when no token has come for the first time; the driver waits for the second one at most."""
_LONGEST_TITLE = 256
_NODE, _BRIDGE = "linked_fleet_agent", "zenoh-bridge-ros2dds"
USUAL_CONTROLLER = "joint_trajectory_controller/joint_trajectory"
_NO_CONTROLLER = "no trajectory controller of the robot has it"


def types_of(address: Address) -> MessageTypes:
    """Return the types that are known for an address. Raises AddressError for a distribution that is not."""
    try:
        return MessageTypes(address.types, address.distro)
    except DefinitionError as error:
        raise AddressError(f"distro: {error}") from error


async def open_session(name: str, address: Address, hash_of: Callable[[str], str], deadline_s: float) -> RosSession:
    """Open the session of an address. Raises ConnectionError if its endpoint does not answer in time."""
    _log.debug("%s: waiting for %s at %s", name, address.description, address.endpoint)
    while True:
        try:
            return await asyncio.to_thread(
                RosSession, address.endpoint, address.domain, _NODE, hash_of, address.bridge_only
            )
        except ConnectionError:
            if time.monotonic() > deadline_s:
                raise
            await asyncio.sleep(_LOOK_S)


def listen_to_descriptions(graph: Graph, address: Address) -> Mailbox:
    return graph.subscribe(Interface(address.description, cdr.STRING), cdr.MAX_TEXT_BYTES, most=2, latched=True)


async def described(name: str, address: Address, graph: Graph, box: Mailbox, deadline_s: float) -> Facts:
    """Return the facts of the first valid description. Raises TimeoutError with the reason of the last refusal."""
    refused = ""
    while time.monotonic() < deadline_s:
        for arrived in box.fetch():
            try:
                return facts_of(name, arrived)
            except (cdr.CdrError, UrdfError) as error:
                refused = f": the last one is refused: {error}"
                _log.warning("%s: bad description: %s", name, error)
        await asyncio.sleep(_LOOK_S)
    by = f"by {_BRIDGE}" if address.bridge_only else f"in domain {address.domain} of rmw_zenoh"
    by += f" or by {_BRIDGE}" if not address.bridge_only and isinstance(graph, RosSession) and graph.is_bridged else ""
    met = "" if graph.offers() else "; no node of ROS was met there"
    raise TimeoutError(f"no usable robot description came on {address.description} {by}{met}{refused}")


async def settled(graph: Graph) -> None:
    """Wait until the graph is quiet, because tokens and descriptions arrive in any order."""
    begun_s = quiet_s = time.monotonic()
    version = graph.version
    while (now_s := time.monotonic()) < begun_s + _SETTLE_S and now_s < quiet_s + _QUIET_S:
        if graph.version != version:
            version, quiet_s = graph.version, now_s
        await asyncio.sleep(_LOOK_S)


async def controllers_of(graph: Graph, types: MessageTypes, address: Address, facts: Facts) -> Controllers:
    """Return the controllers of a robot: those of its address, else those that it states.

    Without either, the only one that takes trajectories, or the usual one, has all joints.
    """
    if address.controllers:
        return Controllers(address.controllers)
    if (found := await find_controllers(graph, types, address.namespace, free_joints(facts))) is not None:
        return found
    nodes = takes_trajectories(graph.offers(), address.namespace)
    return Controllers((Controller(f"{nodes[0]}/joint_trajectory"),)) if len(nodes) == 1 else usual_controllers(address)


def usual_controllers(address: Address) -> Controllers:
    """Return the controllers of an address, or the usual one, which has all joints."""
    return Controllers(address.controllers or (Controller(f"{address.namespace}/{USUAL_CONTROLLER}"),))


def facts_of(name: str, arrived: ReceivedMessage) -> Facts:
    """Parse a description. Raises CdrError or UrdfError if it is not that of a robot with joints."""
    if arrived.payload is None:
        raise cdr.CdrError("it is too long")
    urdf = cdr.read_string(arrived.payload)
    model, joints = RobotModel.for_urdf(urdf), joints_of(urdf)
    names = {joint.name for joint in joints}
    if not 0 < len(names) == len(joints) <= cdr.MAX_JOINTS:
        raise UrdfError(f"{len(joints)} joints with {len(names)} different names are not the joints of a robot")
    return Facts(model.name[:_LONGEST_TITLE], urdf, joints)


def with_meshes(name: str, facts: Facts, address: Address, roots: MeshRoots) -> Facts:
    """Return the facts with the meshes in the folders of the address and in ``roots``."""
    all_roots = MeshRoots((*address.meshes, *roots.folders), roots.prefixes)
    return replace(facts, meshes=mesh_files(facts.urdf, None, all_roots, name))


def with_controllers(facts: Facts, controllers: Sequence[Controller], tolerance: float | None) -> Facts:
    """Return the facts with the joints of each controller coupled, and those of none passive. Raises AddressError."""
    free = free_joints(facts)
    for controller in controllers:
        missing = [joint for joint in controller.joints if joint not in free]
        if missing:
            raise AddressError(f"{controller.topic} is configured for {', '.join(missing)}, which take no commands")
    coupled = tuple(joints_of_controller(each, facts) for each in controllers)
    led = {joint for group in coupled for joint in group}
    joints = (
        replace(joint, tolerance=tolerance)
        if joint.name in led or joint.mimics
        else replace(joint, tolerance=tolerance, passive=True, refusal=joint.refusal or _NO_CONTROLLER)
        for joint in facts.joints
    )
    return replace(facts, joints=tuple(joints), coupled=coupled)


def joints_of_controller(controller: Controller, facts: Facts) -> tuple[str, ...]:
    return controller.joints or free_joints(facts)


def free_joints(facts: Facts) -> tuple[str, ...]:
    """Return the joints that mimic no other one."""
    return tuple(joint.name for joint in facts.joints if joint.mimics is None)
