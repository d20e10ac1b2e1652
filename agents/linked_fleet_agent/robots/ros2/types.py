"""Types of ROS 2 messages, services and actions: found by name and hash, read from and written to bytes.

A type differs between distributions of ROS. Its hash (REP 2016), which peers state, decides which one is meant. Where
none is stated, as in Humble, it is that of the preferred distribution, and a message that does not fit it is read as
one of the next distribution that it fits.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from linked_fleet_agent.robots.ros2.definitions import (
    Definition,
    DefinitionError,
    Definitions,
    Field,
    check_name,
    derived,
)
from linked_fleet_agent.robots.ros2.distributions import DISTRIBUTIONS, InterfaceFolder, distribution
from linked_fleet_agent.robots.ros2.serialization import MAX_MESSAGE_BYTES, CdrError, Serializer
from linked_fleet_agent.robots.ros2.type_descriptions import definitions_of, type_hash

GET_TYPE_DESCRIPTION = "type_description_interfaces/srv/GetTypeDescription"
MAX_DESCRIPTION_BYTES = 1_048_576
MAX_DESCRIPTIONS = 256
"""Most types that nodes describe, so that a hostile one costs a bounded amount of memory."""


class _Origin:
    """Definitions of one origin, with what is made of them."""

    def __init__(self, definitions: Mapping[str, Definition]) -> None:
        self.definitions = definitions
        self.serializer = Serializer(definitions)
        self._hashes = dict[str, str]()

    def hash_of(self, name: str) -> str:
        """Return the hash of a type, empty if a part of it is not defined, as those of events are not in Humble."""
        if name not in self._hashes:
            try:
                self._hashes[name] = type_hash(self.definitions, name)
            except DefinitionError:
                self._hashes[name] = ""
        return self._hashes[name]


@dataclass(frozen=True)
class MessageType:
    """The type of a message. One whose hash nobody has stated has ``others``, which it may be as well."""

    name: str
    origin: _Origin
    others: tuple[_Origin, ...] = ()

    @property
    def hash(self) -> str:
        return self.origin.hash_of(self.name)

    @property
    def definitions(self) -> Mapping[str, Definition]:
        """The definitions of this type and of all that it contains."""
        return self.origin.definitions

    @property
    def fields(self) -> tuple[Field, ...]:
        return self.definitions[self.name].fields

    @property
    def constants(self) -> dict[str, Any]:
        return dict(self.definitions[self.name].constants)

    def check(self) -> None:
        """Raise DefinitionError if no message of this type can be read or written."""
        self.origin.serializer.zero(self.name)

    def read(self, payload: bytes, most_bytes: int = MAX_MESSAGE_BYTES) -> dict[str, Any]:
        """Return the fields of a message. Raises CdrError for bytes that are none."""
        try:
            return self.origin.serializer.read(payload, self.name, most_bytes)
        except CdrError:
            for other in self.others:
                with suppress(CdrError):
                    return other.serializer.read(payload, self.name, most_bytes)
            raise

    def write(self, value: Mapping[str, Any]) -> bytes:
        """Return the bytes of a message. Fields that are left out have their defaults.

        Raises CdrError, which names the field, for a value that the type cannot have.
        """
        return self.origin.serializer.write(value, self.name)

    def part(self, suffix: str) -> "MessageType":
        """Return the type of a part, whose name is this one with a suffix such as ``_Request``."""
        return MessageType(self.name + suffix, self.origin, self.others)


@dataclass(frozen=True)
class _TypeOfParts:
    """A type that consists of the types of messages."""

    itself: MessageType

    @property
    def name(self) -> str:
        return self.itself.name

    @property
    def hash(self) -> str:
        return self.itself.hash


class ServiceType(_TypeOfParts):
    """The type of a service."""

    @property
    def request(self) -> MessageType:
        return self.itself.part("_Request")

    @property
    def response(self) -> MessageType:
        return self.itself.part("_Response")


class ActionType(_TypeOfParts):
    """The type of an action, and of the services and the topic that it consists of."""

    @property
    def goal(self) -> MessageType:
        return self.itself.part("_Goal")

    @property
    def result(self) -> MessageType:
        return self.itself.part("_Result")

    @property
    def feedback(self) -> MessageType:
        return self.itself.part("_Feedback")

    @property
    def feedback_message(self) -> MessageType:
        return self.itself.part("_FeedbackMessage")

    @property
    def send_goal(self) -> ServiceType:
        return ServiceType(self.itself.part("_SendGoal"))

    @property
    def get_result(self) -> ServiceType:
        return ServiceType(self.itself.part("_GetResult"))


class MessageTypes:
    """All types that are known: those of distributions of ROS, of folders, and what nodes have described.

    Those of ``folders`` come first. A ``preferred`` distribution is asked before the others for a type without a hash.
    """

    def __init__(self, folders: Sequence[Path] = (), preferred: str = "") -> None:
        if preferred and preferred not in DISTRIBUTIONS:
            raise DefinitionError(
                f"{preferred!r} is no distribution whose types are known; {', '.join(DISTRIBUTIONS)} are"
            )
        self._own = [InterfaceFolder(each) for each in folders]
        self._order = dict.fromkeys((preferred or DISTRIBUTIONS[0], *DISTRIBUTIONS))
        self._origins = dict[str, _Origin]()
        self._described = dict[tuple[str, str], _Origin]()

    def message(self, name: str, hash: str = "") -> MessageType:
        """Return the type of a message, which has this ``hash`` if one is given.

        Raises DefinitionError if it is not known, and says whether it is the type or the hash.
        """
        return self._find(name, {name: hash} if hash else {})

    def service(self, name: str, hash: str = "") -> ServiceType:
        """Return the type of a service, such as ``std_srvs/srv/Trigger``. Raises DefinitionError."""
        return ServiceType(self.message(name, hash))

    def action(self, name: str, hashes: Mapping[str, str] | None = None) -> ActionType:
        """Return the type of an action, such as ``control_msgs/action/FollowJointTrajectory``.

        Peers state the ``hashes`` of its parts, by their types such as ``…/FollowJointTrajectory_SendGoal``. Raises
        DefinitionError.
        """
        return ActionType(self._find(name, {part: hash for part, hash in (hashes or {}).items() if hash}))

    def hash_of(self, name: str) -> str:
        """Return the hash of a message or service as it is known here. Raises DefinitionError."""
        return self.message(name).hash

    def _find(self, name: str, hashes: Mapping[str, str]) -> MessageType:
        found = [each for each in self._all() if check_name(name) in each.definitions]
        described = [each for (type_, _), each in self._described.items() if type_ == name]
        if not found and not described:
            raise DefinitionError(f"the type {name} is not known")
        fitting = [
            each for each in (*found, *described) if all(each.hash_of(part) == hash for part, hash in hashes.items())
        ]
        if not fitting:
            stated = ", ".join(hash[:80] for hash in hashes.values())
            raise DefinitionError(f"the type {name} is known, but not as the other side has it ({stated})")
        return MessageType(name, fitting[0], () if name in hashes else _different(name, fitting))

    def describe(self, description: Mapping[str, Any], hash: str = "") -> MessageType:
        """Add what a node says about a type, a TypeDescription.

        Raises DefinitionError if it cannot be used, or has another ``hash`` than the one that was asked for.
        """
        name = description["type_description"]["type_name"]
        definitions = definitions_of(description)
        found = type_hash(definitions, check_name(name))
        if hash and hash != found:
            raise DefinitionError(f"the description of {name} has the hash {found}, not {hash[:80]}")
        return self._keep(name, found, definitions)

    def describe_action(self, name: str, descriptions: Iterable[Mapping[str, Any]]) -> ActionType:
        """Add an action by the descriptions of its services and its feedback. Raises DefinitionError."""
        parts = {type_: each for said in descriptions for type_, each in definitions_of(said).items()}
        parts.update({each.name: each for each in derived(check_name(name))})
        definitions = Definitions(parts)
        return ActionType(self._keep(name, type_hash(definitions, name), definitions))

    def _keep(self, name: str, hash: str, definitions: Mapping[str, Definition]) -> MessageType:
        if (name, hash) not in self._described:
            if len(self._described) >= MAX_DESCRIPTIONS:
                raise DefinitionError(f"{MAX_DESCRIPTIONS} types are described already, and no more may be")
            origin = _Origin(definitions)
            for part in _messages_of(definitions, name):
                origin.serializer.zero(part)
            self._described[name, hash] = origin
        return MessageType(name, self._described[name, hash])

    def _all(self) -> Iterator[_Origin]:
        for name in self._order:
            if name not in self._origins:
                self._origins[name] = _Origin(Definitions({}, (*self._own, distribution(name))))
            yield self._origins[name]


def _different(name: str, found: Sequence[_Origin]) -> tuple[_Origin, ...]:
    """Return those that define the type in another way than the first."""
    seen = {_shape(found[0], name)}
    others = list[_Origin]()
    for each in found[1:]:
        if (shape := _shape(each, name)) not in seen:
            seen.add(shape)
            others.append(each)
    return tuple(others)


def _shape(origin: _Origin, name: str) -> str:
    """Return what tells types of one name apart: their hash, or without one the fields of their messages."""
    return origin.hash_of(name) or repr(
        [origin.definitions.get(each) for each in _messages_of(origin.definitions, name)]
    )


def _messages_of(definitions: Mapping[str, Definition], name: str) -> list[str]:
    """Return the types of messages of which a service or an action consists, or the type of a message itself."""
    suffixes = ("_Request", "_Response", "_Goal", "_Result", "_Feedback")
    return [each for suffix in suffixes if (each := name + suffix) in definitions] or [name]
