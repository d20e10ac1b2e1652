"""The address of a ROS 2 robot, as in ``--robot NAME=ros2:ENDPOINT?OPTIONS``. Pure."""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import parse_qsl

SCHEMES = ("ros2:", "ros2dds:")
_ENDPOINT = re.compile(r"((tcp|tls|quic|udp|ws)/[^\s?#/]+:[0-9]{1,5}|unixsock-stream/[^\s?#]+)(#[^\s?]+)?")
# Names of topics and namespaces (ROS 2 design, "Topic and Service name mapping"): no segment begins with a digit.
_RELATIVE = re.compile(r"[A-Za-z_][A-Za-z0-9_]*(/[A-Za-z_][A-Za-z0-9_]*)*")
_LONGEST_NAME = 255
MAX_DOMAIN = 232
SHORTEST_STALE_S, LONGEST_STALE_S = 0.05, 10.0
WIDEST_TOLERANCE = 0.1


class AddressError(ValueError):
    """The text is not the address of a ROS 2 robot; the message says what is expected."""


@dataclass(frozen=True)
class Controller:
    """A controller: the topic on which it takes trajectories, and its joints. No joints means all of the robot."""

    topic: str
    joints: tuple[str, ...] = ()


@dataclass(frozen=True)
class Address:
    """A Zenoh endpoint of the ROS 2 side, and the topics of one robot there, by their full names.

    The robot counts as not measurable after ``stale_s`` without joint states. A motion succeeds when its joints stand
    within ``tolerance`` (rad or m) of their targets; None derives it from the joint states. ``meshes`` are folders of
    this machine with the packages, or the meshes, that the description names. With ``bridge_only`` the driver joins ROS
    by zenoh-bridge-ros2dds alone, else by rmw_zenoh too. Without ``controllers`` the robot is asked for its own.
    ``types`` are folders with definitions of messages, ``distro`` is the distribution of ROS if its types do not say.
    ``expose`` and ``deny`` are patterns of names of topics, services and actions that become components, or do not,
    beside those of the file ``config``.
    """

    endpoint: str
    domain: int = 0
    bridge_only: bool = False
    namespace: str = ""
    states: str = "/joint_states"
    description: str = "/robot_description"
    controllers: tuple[Controller, ...] = ()
    stale_s: float = 0.5
    tolerance: float | None = None
    meshes: tuple[Path, ...] = ()
    types: tuple[Path, ...] = ()
    distro: str = ""
    config: Path | None = None
    expose: tuple[str, ...] = ()
    deny: tuple[str, ...] = ()


def parse_address(text: str) -> Address:
    """Parse ``ros2:ENDPOINT?domain=0&namespace=/arm&…``, or ``ros2dds:…``. Raises AddressError.

    Topics without a leading slash are relative to the namespace. ``commands=TOPIC:JOINT;JOINT`` may be repeated, once
    for each controller, and ``meshes=FOLDER`` for each folder.
    """
    scheme, _, rest = text.partition(":")
    endpoint, separator, query = rest.partition("?")
    if f"{scheme}:" not in SCHEMES or not _ENDPOINT.fullmatch(endpoint):
        raise AddressError(
            f"{text!r} is neither ros2:ENDPOINT nor ros2dds:ENDPOINT with a Zenoh endpoint such as tcp/192.0.2.1:7447"
        )
    given = _options(query) if separator else {}
    bridge_only = scheme == "ros2dds"
    if bridge_only and "domain" in given:
        raise AddressError("domain: the bridge of a ros2dds: address has its own ROS_DOMAIN_ID; leave out the option")
    namespace = _namespace(_one(given, "namespace", "/"))
    commands = given.pop("commands", [])
    folders, types = given.pop("meshes", []), given.pop("types", [])
    expose, deny = given.pop("expose", []), given.pop("deny", [])
    config = _one(given, "config", "")
    address = Address(
        endpoint=endpoint,
        bridge_only=bridge_only,
        namespace=namespace,
        domain=_domain(_one(given, "domain", "0")),
        states=_topic(_one(given, "states", "joint_states"), namespace),
        description=_topic(_one(given, "description", "robot_description"), namespace),
        controllers=_controllers(commands, namespace),
        stale_s=_stale(_one(given, "stale", "0.5")),
        tolerance=_tolerance(_one(given, "tolerance", "")),
        meshes=tuple(_folder("meshes", each) for each in folders),
        types=tuple(_folder("types", each) for each in types),
        distro=_one(given, "distro", ""),
        config=_file(config) if config else None,
        expose=tuple(expose),
        deny=tuple(deny),
    )
    if given:
        known = (
            "domain, namespace, states, description, commands, stale, tolerance, meshes, types, distro, config, expose "
            "and deny"
        )
        raise AddressError(f"{next(iter(given))!r} is not an option of a ROS 2 robot; the options are {known}")
    return address


def _options(query: str) -> dict[str, list[str]]:
    try:
        pairs = parse_qsl(query, keep_blank_values=True, strict_parsing=True, max_num_fields=64, errors="strict")
    except ValueError as error:
        raise AddressError(f"{query!r} is not OPTION=VALUE&OPTION=VALUE: {error}") from error
    if not pairs:
        raise AddressError("no options follow the question mark; OPTION=VALUE&OPTION=VALUE is expected")
    options: dict[str, list[str]] = {}
    for name, value in pairs:
        options.setdefault(name, []).append(value)
    return options


def _one(given: dict[str, list[str]], name: str, default: str) -> str:
    values = given.pop(name, [default])
    if len(values) > 1:
        raise AddressError(f"{name!r} is given {len(values)} times")
    return values[0]


def _domain(text: str) -> int:
    if not re.fullmatch(r"[0-9]{1,3}", text) or int(text) > MAX_DOMAIN:
        raise AddressError(f"domain={text!r} is not a number from 0 to {MAX_DOMAIN}")
    return int(text)


def _stale(text: str) -> float:
    least, most = SHORTEST_STALE_S, LONGEST_STALE_S
    if not re.fullmatch(r"[0-9]{1,2}(\.[0-9]{1,6})?", text) or not least <= float(text) <= most:
        raise AddressError(f"stale={text!r} is not a number of seconds from {least:g} to {most:g}")
    return float(text)


def _tolerance(text: str) -> float | None:
    if not text:
        return None
    if not re.fullmatch(r"0?\.[0-9]{1,6}", text) or not 0.0 < float(text) <= WIDEST_TOLERANCE:
        raise AddressError(f"tolerance={text!r} is not a number above 0 and up to {WIDEST_TOLERANCE:g} (rad or m)")
    return float(text)


def _folder(option: str, text: str) -> Path:
    if not Path(text).is_dir():
        raise AddressError(f"{option}={text!r} is not a folder of this machine")
    return Path(text)


def _file(text: str) -> Path:
    if not Path(text).is_file():
        raise AddressError(f"config={text!r} is not a file of this machine")
    return Path(text)


def _namespace(text: str) -> str:
    """Return an empty string for the root, else the namespace with a leading and no trailing slash."""
    if text != "/" and not (text.startswith("/") and _RELATIVE.fullmatch(text[1:])):
        raise AddressError(f"namespace={text!r} is not a ROS namespace such as /arm")
    return text.rstrip("/")


def _topic(text: str, namespace: str) -> str:
    full = text if text.startswith("/") else f"{namespace}/{text}"
    if len(full) > _LONGEST_NAME or not _RELATIVE.fullmatch(full[1:]):
        raise AddressError(f"{text!r} is not the name of a ROS topic such as joint_states or /arm/joint_states")
    return full


def _controllers(values: Sequence[str], namespace: str) -> tuple[Controller, ...]:
    found = tuple(_controller(value, namespace) for value in values)
    topics = [controller.topic for controller in found]
    joints = [joint for controller in found for joint in controller.joints]
    if len(set(topics)) < len(topics) or len(set(joints)) < len(joints):
        raise AddressError("commands: each topic and each joint may be given only once")
    if len(found) > 1 and not all(controller.joints for controller in found):
        raise AddressError("commands: if there are several, each must name its joints, as in TOPIC:JOINT;JOINT")
    return found


def _controller(value: str, namespace: str) -> Controller:
    topic, separator, joints = value.partition(":")
    names = tuple(joints.split(";")) if separator else ()
    if not all(names):
        raise AddressError(f"commands={value!r} is not TOPIC or TOPIC:JOINT;JOINT")
    return Controller(_topic(topic, namespace), names)
