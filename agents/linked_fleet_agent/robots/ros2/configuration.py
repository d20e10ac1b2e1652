"""The configuration of what else of a ROS graph a robot has: a TOML file of entries, and patterns of names. Pure.

An entry makes a topic a property or an event, and a service, an action or a topic an action of a component.
"""

import re
import tomllib
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Annotated, Any, TypeVar

import msgspec
from msgspec import Meta, Struct, field
from msgspec.structs import replace

from linked_fleet_agent.robots.ros2.address import AddressError
from linked_fleet_agent.robots.ros2.definitions import DefinitionError, check_name
from linked_fleet_agent.robots.ros2.units import Meaning
from linked_fleet_agent.wire.declaration import Duration, Rate
from linked_fleet_agent.wire.schema import Iri, Prose, Title, Unit

MAX_FILE_BYTES, MAX_ENTRIES, MAX_PATTERNS = 1_048_576, 256, 64
ROOT_COMPONENT = "ros"
"""The component of topics, services and actions that have no namespace."""

_NAME = re.compile(r"(/[A-Za-z_][A-Za-z0-9_]*)+\Z")
_PATTERN = re.compile(r"[A-Za-z0-9_/*?]{1,255}\Z")
_MEMBER = re.compile(r"[A-Za-z_][A-Za-z0-9_]*\Z")
_LONGEST_NAME = 255
Text = Annotated[str, Meta(max_length=_LONGEST_NAME)]
Stale = Annotated[float, Meta(ge=0.1, le=3600)]


class ConfigurationError(AddressError):
    """The configuration cannot be used; the message names the file and the table, and says what would be right."""


class Entry(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The keys of all entries. ``component`` and ``name`` are what the fleet calls it; its names in ROS by default.

    ``type`` may be left out if a node offers it. Values and inputs are the whole message, or the ``field`` in it.
    """

    component: Text = ""
    name: Text = ""
    type: Text = ""
    title: Title = ""
    description: Prose = ""
    term: Iri = ""

    @property
    def ros_name(self) -> str:
        """The name in ROS."""
        raise NotImplementedError

    @property
    def kind(self) -> str:
        """The kind of the type: ``msg``, ``srv`` or ``action``."""
        return "msg"


class PropertyEntry(Entry, frozen=True, kw_only=True):
    """A topic that is a property, and can be set if ``write``. It is unknown if no message came for ``stale_s``.

    A ``latched`` one keeps its last message, as long as its publisher is there; what the publisher says by default.
    """

    topic: Text
    field: Text = ""
    unit: Unit = ""
    write: bool = False
    latched: bool | None = None
    stale_s: Stale | None = None

    @property
    def ros_name(self) -> str:
        return self.topic


class EventEntry(Entry, frozen=True, kw_only=True):
    """A topic whose messages are events, up to ``rate_hz`` a second; more are dropped and counted."""

    topic: Text
    field: Text = ""
    rate_hz: Rate = 10.0

    @property
    def ros_name(self) -> str:
        return self.topic


class ActionEntry(Entry, frozen=True, kw_only=True):
    """A service, an action or a topic that is an action; a topic gets the input as one message.

    ``moves`` names joints or ``base``; it then is a motion.
    """

    service: Text = ""
    action: Text = ""
    topic: Text = ""
    moves: Annotated[tuple[Text, ...], Meta(max_length=256)] = ()
    duration_s: Duration | None = None
    stop_s: Annotated[float, Meta(gt=0, le=30)] = 5.0

    @property
    def ros_name(self) -> str:
        return self.service or self.action or self.topic

    @property
    def kind(self) -> str:
        return "srv" if self.service else "action" if self.action else "msg"


class ComponentEntry(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The description of a component itself. ``kind`` is the IRI of its class, ``link`` where it is mounted."""

    title: Title = ""
    description: Prose = ""
    kind: Iri = ""
    link: Annotated[str, Meta(max_length=128)] = ""
    rate_hz: Rate = 10.0
    stale_s: Stale = 5.0


class _UnitEntry(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    unit: Unit = ""
    term: Iri = ""


class Configuration(Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The configuration of one robot: entries, patterns of names to ``expose`` or ``deny``, and units of fields."""

    properties: Annotated[tuple[PropertyEntry, ...], Meta(max_length=MAX_ENTRIES)] = field(default=(), name="property")
    events: Annotated[tuple[EventEntry, ...], Meta(max_length=MAX_ENTRIES)] = field(default=(), name="event")
    actions: Annotated[tuple[ActionEntry, ...], Meta(max_length=MAX_ENTRIES)] = field(default=(), name="action")
    components: dict[str, ComponentEntry] = field(default={}, name="component")
    expose: tuple[Text, ...] = ()
    deny: tuple[Text, ...] = ()
    units: dict[str, Unit | _UnitEntry] = {}

    @property
    def entries(self) -> tuple[Entry, ...]:
        return (*self.properties, *self.events, *self.actions)

    @property
    def meanings(self) -> Mapping[str, Meaning]:
        """The units and terms of fields that the file states."""
        return {
            key: Meaning(said) if isinstance(said, str) else Meaning(said.unit, said.term)
            for key, said in self.units.items()
        }

    def __bool__(self) -> bool:
        return bool(self.entries or self.expose)


E = TypeVar("E", bound=Entry)


def read_configuration(
    path: Path | None, namespace: str = "", expose: Iterable[str] = (), deny: Iterable[str] = ()
) -> Configuration:
    """Return the configuration of a file, if any, with further patterns.

    Names without a leading slash are relative to the ``namespace``, which is empty or as ``/arm``. Raises
    ConfigurationError.
    """
    where = str(path or "expose and deny")
    said = _decoded(path) if path is not None else Configuration()
    try:
        return _checked(replace(said, expose=(*said.expose, *expose), deny=(*said.deny, *deny)), namespace)
    except ConfigurationError as error:
        raise ConfigurationError(f"{where}: {error}") from error


def _decoded(path: Path) -> Configuration:
    try:
        with path.open("rb") as file:
            text = file.read(MAX_FILE_BYTES + 1)
        if len(text) > MAX_FILE_BYTES:
            raise ConfigurationError(f"{path} has more than {MAX_FILE_BYTES} bytes")
        return msgspec.convert(tomllib.loads(text.decode()), Configuration)
    except OSError as error:
        raise ConfigurationError(f"{path} cannot be read: {error.strerror}") from error
    except (UnicodeDecodeError, tomllib.TOMLDecodeError, RecursionError) as error:
        raise ConfigurationError(f"{path} is not TOML: {error}") from error
    except msgspec.ValidationError as error:
        raise ConfigurationError(f"{path}: {_sentence(str(error))}") from error


_TABLES: Mapping[str, type[Struct]] = {
    "property": PropertyEntry, "event": EventEntry, "action": ActionEntry, "component": ComponentEntry,
}  # fmt: skip


def _sentence(said: str) -> str:
    """Return what msgspec says about a value, with the table by its name and number and the keys that it may have."""
    what, _, where = said.partition(" - at `$")
    match = re.match(r"\.(?P<table>\w+)(?:\[(?P<index>\d+)\]|\[\.\.\.\])?(?P<rest>[^`]*)", where)
    table = match["table"] if match else ""
    if match is None or table not in _TABLES:
        keys = ", ".join(Configuration.__struct_encode_fields__)
        return f"{what}{f', in {table}' if table else ''}; the tables and keys are {keys}"
    number = f" number {int(match['index']) + 1}" if match["index"] else ""
    name = f"[[{table}]]" if table != "component" else "[component.NAME]"
    inside = f", {match['rest'].lstrip('.')}" if match["rest"] else ""
    keys = ", ".join(_TABLES[table].__struct_encode_fields__)
    return f"{name}{number}{inside}: {what[:1].lower()}{what[1:]}; its keys are {keys}"


def _checked(said: Configuration, namespace: str) -> Configuration:
    if len(said.expose) + len(said.deny) > MAX_PATTERNS:
        raise ConfigurationError(f"{MAX_PATTERNS} patterns are the maximum")
    found = replace(
        said,
        properties=_entries("property", said.properties, namespace),
        events=_entries("event", said.events, namespace),
        actions=_entries("action", said.actions, namespace),
        expose=tuple(_pattern(each, namespace) for each in said.expose),
        deny=tuple(_pattern(each, namespace) for each in said.deny),
    )
    for name in found.components:
        _check_member("[component.NAME]", name)
    members = set[tuple[str, str]]()
    for entry in found.entries:
        member = (entry.component, entry.name)
        if member in members:
            raise ConfigurationError(f"{member[0]} has two members {member[1]!r}; give one of them another 'name'")
        members.add(member)
    return found


def _entries(table: str, entries: Iterable[E], namespace: str) -> tuple[E, ...]:
    return tuple(_entry(f"[[{table}]] number {number}", each, namespace) for number, each in enumerate(entries, 1))


def _entry(where: str, entry: E, namespace: str) -> E:
    given = [key for key in ("topic", "service", "action") if getattr(entry, key, "")]
    if len(given) != 1:
        raise ConfigurationError(
            f"{where} names {' and '.join(given) or 'nothing'}; one of topic, service, action is right"
        )
    key = given[0]
    full = full_name(where, getattr(entry, key), namespace)
    component, name = names_of(full, namespace)
    made: dict[str, Any] = {key: full, "component": entry.component or component, "name": entry.name or name}
    _check_member(where, made["component"])
    _check_member(where, made["name"])
    if entry.type:
        try:
            check_name(entry.type)
        except DefinitionError as error:
            raise ConfigurationError(f"{where}: {error}") from error
        if entry.type.split("/")[1] != entry.kind:
            raise ConfigurationError(
                f"{where}: {entry.type} is not the type of a {key}; that of a {key} is PACKAGE/{entry.kind}/NAME"
            )
    return replace(entry, **made)


def full_name(where: str, name: str, namespace: str) -> str:
    """Return a name with its namespace. Raises ConfigurationError if it is none."""
    full = name if name.startswith("/") else f"{namespace}/{name}"
    if len(full) > _LONGEST_NAME or not _NAME.match(full):
        raise ConfigurationError(f"{where}: {name!r} is not a name of ROS such as /lamp/level")
    return full


def names_of(full: str, namespace: str) -> tuple[str, str]:
    """Return the component and the member that stand for a name by default: its namespace, and the rest."""
    above, _, name = full.removeprefix(f"{namespace}/").lstrip("/").rpartition("/")
    return above.replace("/", "_") or ROOT_COMPONENT, name


def _check_member(where: str, name: str) -> None:
    if not _MEMBER.match(name) or len(name) > 128:
        raise ConfigurationError(f"{where}: {name!r} is no name; letters, digits and _ make one")


def _pattern(pattern: str, namespace: str) -> str:
    if not _PATTERN.match(pattern):
        raise ConfigurationError(f"{pattern!r} is not a pattern of names such as /lamp/*")
    return pattern if pattern[0] in "/*" else f"{namespace}/{pattern}"
