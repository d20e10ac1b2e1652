"""Small robot descriptions, and what agent and gateway make of them."""

from dataclasses import dataclass
from pathlib import Path

from linked_fleet_agent.robots.catalogue import UnavailableError, load
from linked_fleet_agent.wire.codec import layout
from linked_fleet_agent.wire.messages import WIRE_VERSION, Description
from linked_fleet_state.events import Appeared, Described
from linked_fleet_state.fleet import Fleet
from linked_fleet_state.model import Joint
from linked_fleet_state.robot import Robot

INERTIAL = '<inertial><mass value="1"/><inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial>'
BAR = '<geometry><box size="0.02 0.02 0.6"/></geometry>'
LIMIT = '<limit lower="-1.5" upper="1.5" velocity="1" effort="50"/>'


def link(name: str, inside: str = INERTIAL) -> str:
    return f'<link name="{name}">{inside}</link>'


def joint(
    name: str, parent: str, child: str, inside: str = LIMIT, kind: str = "revolute", axis: str = '<axis xyz="0 1 0"/>'
) -> str:
    ends = f'<parent link="{parent}"/><child link="{child}"/>'
    return f'<joint name="{name}" type="{kind}">{ends}{axis}{inside}</joint>'


def robot(body: str, attributes: str = "", prolog: str = "") -> str:
    return f'{prolog}<robot name="r"{attributes}>{body}</robot>'


def arm(first: str = LIMIT, upper: str = INERTIAL, attributes: str = "", more: str = "", prolog: str = "") -> str:
    """Return an arm of the joints j1 and j2; ``first``: what is in j1, ``upper``: what is in the link that it moves."""
    links = link("base") + link("upper", upper) + link("tool")
    return robot(links + joint("j1", "base", "upper", first) + joint("j2", "upper", "tool") + more, attributes, prolog)


@dataclass(frozen=True)
class Reading:
    """What one side makes of a description: the sentence of its refusal, or the joints, by whether they take
    commands.
    """

    refusal: str = ""
    joints: tuple[tuple[str, bool], ...] = ()


def read_by_agent(content: bytes, folder: Path) -> tuple[Reading, str]:
    """Return what a simulated robot of the agent makes of a file, and the text that it sends to gateways."""
    file = folder / "robot.urdf"
    file.write_bytes(content)
    try:
        facts = load("r", str(file)).describe()
    except UnavailableError as error:
        return Reading(str(error)), ""
    return Reading(joints=tuple((each.name, not each.passive) for each in facts.joints if not each.mimics)), facts.urdf


def described(urdf: str, joints: tuple[str, ...]) -> Robot:
    """Return the robot that a gateway makes of a description."""
    fleet = Fleet()
    said = Description(
        version=WIRE_VERSION, robot="r", incarnation=1, title="R", urdf=urdf, joints=joints, base="fixed",
        rate_hz=50, layout=layout(len(joints), False), capabilities=("move", "follow", "stop"),
    )  # fmt: skip
    for event in (Appeared("r", 1), Described(said)):
        fleet.apply(event, 1)
    return fleet.robots["r"]


def read_by_gateway(urdf: str, joints: tuple[str, ...]) -> Reading:
    found = described(urdf, joints)
    if found.model is None or found.fault:
        return Reading(found.fault or "no model")
    return Reading(joints=tuple((each.name, each.commandable) for each in _led(found)))


def _led(found: Robot) -> list[Joint]:
    assert found.model is not None and found.description is not None
    return [joint for joint in found.model.joints.values() if joint.movable and joint.mimic is None]
