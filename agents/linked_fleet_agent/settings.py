"""Settings of an agent process, read once from environment variables and flags into one frozen object."""

import argparse
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from linked_fleet_agent.mesh_files import NO_ROOTS, MeshRoots
from linked_fleet_agent.motion import Sway
from linked_fleet_agent.wire.keys import Keys, escape
from linked_fleet_agent.wire.trust import Credentials, unauthenticated_endpoints


@dataclass(frozen=True)
class Setting:
    """One row of the documented table. The flag is the variable in lower case without ``LINKED_FLEET_``."""

    variable: str
    default: str
    meaning: str
    repeated: bool = False

    @property
    def flag(self) -> str:
        name = self.variable.removeprefix("LINKED_FLEET_").removeprefix("ZENOH_").lower().replace("_", "-")
        return "--" + name

    @property
    def destination(self) -> str:
        return self.flag.removeprefix("--").replace("-", "_")


SETTINGS = (
    Setting("LINKED_FLEET_NAMESPACE", "fleet", "prefix of every Zenoh key"),
    Setting("LINKED_FLEET_ZENOH_CONNECT", "tcp/127.0.0.1:7447", "endpoints of gateways or routers, comma-separated"),
    Setting("LINKED_FLEET_ZENOH_LISTEN", "", "endpoints to listen on as a Zenoh peer, comma-separated"),
    Setting("LINKED_FLEET_ZENOH_CA", "", "certificate of the authority for tls and quic links"),
    Setting("LINKED_FLEET_ZENOH_CERT", "", "certificate of the agent on these links; all three are needed together"),
    Setting("LINKED_FLEET_ZENOH_KEY", "", "its private key"),
    Setting(
        "LINKED_FLEET_ALLOW", "", "`plain-zenoh`: listen beyond loopback, where everybody may then move the robots"
    ),
    Setting(
        "LINKED_FLEET_ROBOT",
        "",
        "robots, comma-separated: NAME, NAME=MODEL, NAME=FILE.urdf[:floating], or NAME=ros2:ENDPOINT[?OPTIONS] "
        "(docs/ROS2.md); `{host}` is the host's name",
        True,
    ),
    Setting(
        "LINKED_FLEET_SWAY",
        "",
        "demonstration, comma-separated: ROBOT:JOINT moves back and forth until a stop or command; `kill -USR1` of the "
        "agent restarts it",
        True,
    ),
    Setting(
        "LINKED_FLEET_MESH_ROOTS",
        "",
        "folders of packages whose meshes may be served, comma-separated, beside the package of a URDF and those of "
        "`ROS_PACKAGE_PATH` and `AMENT_PREFIX_PATH`",
    ),
    Setting("LINKED_FLEET_RATE_HZ", "100", "state frames per second and robot"),
    Setting("LINKED_FLEET_LEASE_MS", "2000", "silence until an agent counts as gone, in milliseconds"),
    Setting("LINKED_FLEET_LOG_LEVEL", "info", "debug, info, warning or error"),
)


class SettingsError(ValueError):
    """An invalid setting; the message names it and the accepted values."""


@dataclass(frozen=True)
class RobotChoice:
    """A robot to run: ``source`` is a catalogue name or a URDF file, ``floating`` makes the base of a file a free
    joint.
    """

    name: str
    source: str
    floating: bool = False


@dataclass(frozen=True)
class AgentSettings:
    """The settings of one process; see SETTINGS for their meaning."""

    robots: tuple[RobotChoice, ...]
    keys: Keys = field(default_factory=Keys)
    zenoh_connect: tuple[str, ...] = ("tcp/127.0.0.1:7447",)
    zenoh_listen: tuple[str, ...] = ()
    credentials: Credentials | None = None
    sways: tuple[tuple[str, Sway], ...] = ()
    mesh_roots: MeshRoots = NO_ROOTS
    rate_hz: float = 100.0
    lease_ms: int = 2_000
    log_level: str = "INFO"


def read_settings(arguments: Sequence[str], environment: Mapping[str, str], host: str) -> AgentSettings:
    """Read settings; flags precede the environment.

    ``{host}`` in a robot's name becomes ``host``. Raises SettingsError.
    """
    flags = vars(_parser().parse_args(arguments))
    if flags["check"] is not None:
        raise SettingsError("--check FILE stands alone, without other flags")
    text: dict[str, str] = {}
    for setting in SETTINGS:
        given = flags[setting.destination]
        given = ",".join(given) if isinstance(given, list) else given
        text[setting.destination] = environment.get(setting.variable, setting.default) if given is None else given
    robots = tuple(_robot(part, host, flags["floating"]) for part in _parts(text["robot"]))
    names = [robot.name for robot in robots]
    if not robots or len(set(names)) != len(names):
        raise SettingsError(f"--robot: at least one, and no name twice; got {names}")
    credentials = _credentials(text["ca"], text["cert"], text["key"])
    _check_exposure(_parts(text["listen"]), credentials, _parts(text["allow"]))
    return AgentSettings(
        robots=robots,
        keys=_keys(text["namespace"]),
        zenoh_connect=_parts(text["connect"]),
        zenoh_listen=_parts(text["listen"]),
        credentials=credentials,
        sways=tuple(_sway(part, names, host) for part in _parts(text["sway"])),
        mesh_roots=_mesh_roots(_parts(text["mesh_roots"]), environment),
        rate_hz=_number("LINKED_FLEET_RATE_HZ", text["rate_hz"], 1, 1_000),
        lease_ms=int(_number("LINKED_FLEET_LEASE_MS", text["lease_ms"], 200, 60_000)),
        log_level=_level(text["log_level"]),
    )


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser("python -m linked_fleet_agent", description="Agents of one or several robots.")
    for setting in SETTINGS:
        default = f" (default: {setting.default})" if setting.default else ""
        parser.add_argument(
            setting.flag, action="append" if setting.repeated else "store", help=f"{setting.meaning}{default}"
        )
    parser.add_argument(
        "--check", metavar="FILE", help="print what the fleet will see of a driver or of components, and what is wrong"
    )
    parser.add_argument("--floating", action="store_true", help="every URDF file given has a floating base")
    return parser


def _parts(text: str) -> tuple[str, ...]:
    return tuple(part.strip() for part in text.split(",") if part.strip())


def _robot(text: str, host: str, floating: bool) -> RobotChoice:
    name, separator, source = text.partition("=")
    name = name.replace("{host}", host)
    try:
        escape(name)
    except ValueError as error:
        raise SettingsError(f"--robot {text}: {error}") from error
    source = source if separator else name
    freed = source.endswith(":floating")
    return RobotChoice(name, source.removesuffix(":floating"), freed or floating)


def _sway(text: str, robots: Sequence[str], host: str) -> tuple[str, Sway]:
    robot, _, joint = text.replace("{host}", host).partition(":")
    if robot not in robots or not joint:
        raise SettingsError(f"--sway {text}: ROBOT:JOINT with a robot of {', '.join(robots)} is needed")
    return robot, Sway(joint)


def _mesh_roots(folders: Sequence[str], environment: Mapping[str, str]) -> MeshRoots:
    for folder in folders:
        if not Path(folder).is_dir():
            raise SettingsError(f"LINKED_FLEET_MESH_ROOTS: {folder!r} is not a folder of this machine")
    return MeshRoots.from_environment(folders, environment)


def _keys(namespace: str) -> Keys:
    try:
        return Keys(namespace)
    except ValueError as error:
        raise SettingsError(f"LINKED_FLEET_NAMESPACE: {error}") from error


def _credentials(authority: str, certificate: str, key: str) -> Credentials | None:
    try:
        return Credentials.from_optional_files(authority, certificate, key)
    except ValueError as error:
        raise SettingsError(str(error)) from error


def _check_exposure(listen: Sequence[str], credentials: Credentials | None, allowed: Sequence[str]) -> None:
    if not set(allowed) <= {"plain-zenoh"}:
        raise SettingsError(f"LINKED_FLEET_ALLOW: only plain-zenoh can be allowed, not {', '.join(allowed)}")
    exposed = unauthenticated_endpoints(listen, credentials)
    if exposed and not allowed:
        raise SettingsError(
            f"anybody who reaches {', '.join(exposed)} could move the robots: listen on tls/… or quic/… with "
            "LINKED_FLEET_ZENOH_CA, …_CERT and …_KEY, on loopback, or not at all; or say LINKED_FLEET_ALLOW=plain-zenoh"
        )


def _number(variable: str, text: str, least: float, most: float) -> float:
    if not re.fullmatch(r"[0-9]+(\.[0-9]+)?", text) or not least <= float(text) <= most:
        raise SettingsError(f"{variable}: {text!r} is no number from {least:g} to {most:g}")
    return float(text)


def _level(text: str) -> str:
    if text.upper() not in ("DEBUG", "INFO", "WARNING", "ERROR"):
        raise SettingsError(f"LINKED_FLEET_LOG_LEVEL: {text!r} is not one of debug, info, warning, error")
    return text.upper()
