"""The JSON form of ROS 2 messages, with its schema (``wire/schema.py``).

Times and durations are seconds, byte arrays are base64, a UUID is its text. What is deeper than schemas may be comes up
with a joined name, as position_x. A number that is not finite, or that JSON does not carry, is unknown: its member is
left out, and so is an array that has one. What no schema can say at all is left out too, and named in ``left_out``.
"""

import base64
import binascii
import math
from collections.abc import Callable, Iterator, Mapping
from typing import Any, Literal, NamedTuple
from uuid import UUID

from msgspec import UNSET
from msgspec.structs import replace

from linked_fleet_agent.robots.ros2.definitions import FILLER, Definition, DefinitionError, Field
from linked_fleet_agent.robots.ros2.serialization import CdrError
from linked_fleet_agent.robots.ros2.types import MessageType
from linked_fleet_agent.robots.ros2.units import MEANINGS, Meanings, meaning_of
from linked_fleet_agent.wire.schema import MAX_DEPTH, MAX_INTEGER, MAX_ITEMS, MAX_MEMBERS, MAX_NUMBER, MAX_TEXT, Schema

Need = Literal["certain", "all", "none"]
"""The members that a schema requires: those that every message has, all but stamps, or none."""
TIMES = ("builtin_interfaces/msg/Time", "builtin_interfaces/msg/Duration")
UUID_TYPE, HEADER = "unique_identifier_msgs/msg/UUID", "std_msgs/msg/Header"
_OCTETS, _LONG = ("uint8", "byte", "char"), ("int64", "uint64")
_LONGEST_PROSE = 1024


class _Node(NamedTuple):
    """The JSON form of a value. ``to_json`` returns UNSET for one that is unknown; one that is ``certain`` never is."""

    schema: Schema
    to_json: Callable[[Any], Any]
    from_json: Callable[[Any], Any]
    certain: bool


class _Place(NamedTuple):
    """The place of a value: the types around it, each with the path from there, and its depth in the schema."""

    around: tuple[tuple[str, str], ...]
    depth: int

    def at(self, field: str, depth: int) -> "_Place":
        around = tuple((type_, f"{path}.{field}" if path else field) for type_, path in self.around)
        return _Place(around, depth)

    def of(self, type_: str) -> "_Place":
        return _Place((*self.around, (type_, "")), self.depth)

    @property
    def path(self) -> str:
        return self.around[0][1]


class View:
    """The JSON form of messages of one type, or of the ``field`` in them, which may be a path as ``pose.position``.

    A message of one member is that member, if it need not be an object. Raises DefinitionError for a type or field that
    has no JSON form. ``meanings`` come before those that are known.
    """

    def __init__(
        self,
        type_: MessageType,
        meanings: Meanings | None = None,
        field: str = "",
        need: Need = "certain",
        is_object: bool = False,
    ) -> None:
        type_.check()
        self._definitions, self._meanings, self._need = type_.definitions, meanings or {}, need
        self.left_out: list[str] = []
        """Sentences about members that have no JSON form."""
        self._path = field.split(".") if field else _single_member(type_, is_object)
        within, place = _within(type_.definitions, type_.name, self._path)
        node = self._value(within, place)
        if node is None:
            raise DefinitionError(f"{type_.name} has no JSON form: {'; '.join(self.left_out)}")
        self._node, self.schema = node, node.schema

    def value(self, message: Mapping[str, Any]) -> Any:
        """Return the JSON form of a message, or None if it is unknown."""
        said = _known(self._node, _at(message, tuple(self._path)))
        return None if said is UNSET else said

    def message(self, value: Any) -> dict[str, Any]:
        """Return the message of a JSON value that conforms to the schema. Raises CdrError."""
        said = self._node.from_json(value)
        for name in reversed(self._path):
            said = {name: said}
        assert isinstance(said, dict)
        return said

    def _value(self, field: Field, place: _Place) -> _Node | None:
        if field.arity != "one" and field.type not in _OCTETS:
            return self._array(field, place)
        if field.type in self._definitions:
            return self._object(self._definitions[field.type], place.of(field.type))
        return self._leaf(field, place)

    def _leaf(self, field: Field, place: _Place) -> _Node | None:
        if place.depth > MAX_DEPTH:
            self._leave_out(place, f"it is nested more than {MAX_DEPTH} deep")
            return None
        meaning = meaning_of(place.around, self._meanings, MEANINGS)
        node = _leaf_node(field)
        numeric = node.schema.type in ("number", "integer")
        said = replace(node.schema, unit=meaning.unit if numeric else "", semantic_type=meaning.term)
        return node._replace(schema=said)

    def _array(self, field: Field, place: _Place) -> _Node | None:
        if field.arity == "array" and field.size > MAX_ITEMS:
            self._leave_out(place, f"it has {field.size} items; {MAX_ITEMS} is the maximum")
            return None
        item = self._value(_item_of(field), place._replace(depth=place.depth + 1))
        if item is None:
            return None
        meaning = meaning_of(place.around, self._meanings, MEANINGS)
        return _array_node(field, item, meaning.term)

    def _object(self, definition: Definition, place: _Place) -> _Node | None:
        is_scalar = definition.name in (*TIMES, UUID_TYPE)
        if place.depth + (not is_scalar) > MAX_DEPTH:
            self._leave_out(place, f"it is nested more than {MAX_DEPTH} deep")
            return None
        if is_scalar:
            return _UUID_NODE if definition.name == UUID_TYPE else _time_node(place, self._meanings)
        members = dict[str, tuple[tuple[str, ...], _Node, bool]]()
        for path, field, within in self._members(definition, place, ()):
            name = "_".join(path)
            node = self._value(field, within)
            if node is None:
                continue
            if len(members) == MAX_MEMBERS or name in members:
                self._leave_out(within, f"an object has at most {MAX_MEMBERS} members, each with a name of its own")
                continue
            members[name] = path, self._explained(node, field, definition), self._is_required(node, field)
        if not members and place.depth > 1:
            return None
        return _object_node(members)

    def _members(
        self, definition: Definition, place: _Place, above: tuple[str, ...]
    ) -> Iterator[tuple[tuple[str, ...], Field, _Place]]:
        """Yield the members of an object, with those of objects that would be too deep."""
        for field in definition.fields:
            if field.name == FILLER:
                continue
            within, path = place.at(field.name, place.depth + 1), (*above, field.name)
            inner = self._definitions.get(field.type) if field.arity == "one" else None
            if inner is not None and within.depth >= MAX_DEPTH and inner.name not in (*TIMES, UUID_TYPE):
                deeper = within.of(inner.name)._replace(depth=place.depth)
                yield from self._members(inner, deeper, path)
            else:
                yield path, field, within

    def _is_required(self, node: _Node, field: Field) -> bool:
        if self._need == "certain":
            return node.certain
        return self._need == "all" and field.default is None and field.type not in (*TIMES, HEADER)

    def _explained(self, node: _Node, field: Field, definition: Definition) -> _Node:
        """Return the node with what constants say about it, and its default."""
        schema = node.schema
        if field.type not in self._definitions and (prose := _constants(field, definition)):
            schema = replace(schema, description=prose)
        if self._need != "certain" and field.arity == "one" and field.default not in (None, ""):
            schema = replace(schema, default=field.default)
        return node._replace(schema=schema)

    def _leave_out(self, place: _Place, why: str) -> None:
        self.left_out.append(f"{place.path}: {why}")


def _item_of(field: Field) -> Field:
    """Return an item of an array as a field."""
    return Field(field.name, field.type, "one", 0, field.text_size)


def _single_member(type_: MessageType, is_object: bool) -> list[str]:
    names = [field.name for field in type_.fields if field.name != FILLER]
    return names if len(names) == 1 and not is_object else []


def _within(definitions: Mapping[str, Definition], name: str, path: list[str]) -> tuple[Field, _Place]:
    """Return the field at a path. Raises DefinitionError, which names the fields that there are."""
    place, field = _Place(((name, ""),), 1), Field("", name)
    for each in path:
        inner = definitions.get(field.type) if field.arity == "one" else None
        fields = {one.name: one for one in inner.fields} if inner is not None else {}
        if each not in fields:
            known = ", ".join(fields) or "none"
            raise DefinitionError(f"{field.type} has no field {each!r}; its fields are {known}")
        field, place = fields[each], place.at(each, 1)
        if fields[each].type in definitions and each is not path[-1]:
            place = place.of(fields[each].type)
    return field, place if path else _Place((), 1)


def _leaf_node(field: Field) -> _Node:
    if field.arity != "one" and field.type in _OCTETS:
        return _Node(Schema(type="string", max_length=MAX_TEXT), _base64, _bytes, field.arity == "array")
    if field.type == "string":
        schema = Schema(type="string", max_length=field.text_size if 0 < field.text_size <= MAX_TEXT else None)
        return _Node(schema, lambda said: said if len(said) <= MAX_TEXT else UNSET, lambda said: said, True)
    if field.type == "bool":
        return _Node(Schema(type="boolean"), lambda said: said, lambda said: said, True)
    if field.type.startswith("float"):
        return _Node(Schema(type="number"), _finite, lambda said: said, False)
    if field.type in _LONG:
        low = 0 if field.type == "uint64" else None
        return _Node(Schema(type="integer", minimum=low), _exact, lambda said: said, False)
    low, high = _RANGES[field.type]
    return _Node(Schema(type="integer", minimum=low, maximum=high), lambda said: said, lambda said: said, True)


_RANGES = {f"int{bits}": (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1) for bits in (8, 16, 32)}
_RANGES |= {f"uint{bits}": (0, 2**bits - 1) for bits in (8, 16, 32)} | dict.fromkeys(("byte", "char"), (0, 255))


def _finite(said: float) -> Any:
    return said if abs(said) <= MAX_NUMBER else UNSET  # NaN is not


def _exact(said: int) -> Any:
    return said if abs(said) <= MAX_INTEGER else UNSET


def _base64(said: bytes) -> Any:
    return base64.b64encode(said).decode() if len(said) <= MAX_TEXT // 4 * 3 else UNSET


def _bytes(said: str) -> bytes:
    try:
        return base64.b64decode(said, validate=True)
    except (binascii.Error, ValueError) as error:
        raise CdrError(f"{said[:40]!r} is not base64: {error}") from error


def _time_node(place: _Place, meanings: Meanings) -> _Node:
    meaning = meaning_of(place.around, meanings, MEANINGS)
    schema = Schema(type="number", unit=meaning.unit, semantic_type=meaning.term)
    return _Node(schema, lambda said: said["sec"] + said["nanosec"] / 1e9, seconds_as_ros, True)


def seconds_as_ros(seconds: float) -> dict[str, int]:
    """Return seconds as a Time or a Duration."""
    whole = math.floor(seconds)
    nanoseconds = round((seconds - whole) * 1e9)
    return {"sec": whole + nanoseconds // 1_000_000_000, "nanosec": nanoseconds % 1_000_000_000}


def _uuid(said: str) -> dict[str, bytes]:
    try:
        return {"uuid": UUID(said).bytes}
    except ValueError as error:
        raise CdrError(f"{said[:40]!r} is not a UUID") from error


_UUID_NODE = _Node(
    Schema(type="string", min_length=36, max_length=36), lambda said: str(UUID(bytes=said["uuid"])), _uuid, True
)


def _array_node(field: Field, item: _Node, term: str) -> _Node:
    least = field.size if field.arity == "array" else None
    most = field.size if field.arity != "sequence" and field.size <= MAX_ITEMS else None
    items = replace(item.schema, semantic_type="") if item.schema.semantic_type == term else item.schema
    schema = Schema(type="array", items=items, min_items=least, max_items=most, semantic_type=term)

    def to_json(said: Any) -> Any:
        if len(said) > MAX_ITEMS:
            return UNSET
        items = [item.to_json(each) for each in said]
        return UNSET if UNSET in items else items

    return _Node(
        schema, to_json, lambda said: [item.from_json(each) for each in said], least is not None and item.certain
    )


def _object_node(members: Mapping[str, tuple[tuple[str, ...], _Node, bool]]) -> _Node:
    def to_json(said: Any) -> dict[str, Any]:
        found = {name: _known(node, _at(said, path)) for name, (path, node, _) in members.items()}
        return {name: each for name, each in found.items() if each is not UNSET}

    def from_json(said: Any) -> dict[str, Any]:
        message = dict[str, Any]()
        for name, given in said.items():
            path, node, _ = members[name]
            inner = message
            for each in path[:-1]:
                inner = inner.setdefault(each, {})
            try:
                inner[path[-1]] = node.from_json(given)
            except CdrError as error:
                raise CdrError(f"{name}: {error}") from error
        return message

    properties = {name: node.schema for name, (_, node, _) in members.items()}
    required = tuple(name for name, (_, _, required) in members.items() if required)
    return _Node(Schema(type="object", properties=properties, required=required), to_json, from_json, True)


def _at(said: Any, path: tuple[str, ...]) -> Any:
    """Return a member; UNSET if it is missing, as in a message of another distribution."""
    for each in path:
        said = said.get(each, UNSET) if said is not UNSET else UNSET
    return said


def _known(node: _Node, said: Any) -> Any:
    return UNSET if said is UNSET else node.to_json(said)


def _constants(field: Field, definition: Definition) -> str:
    """Return the constants that are values of a field: those of its name, or all if it is the only one of its type."""
    prefix = field.name.upper() + "_"
    named = {name.removeprefix(prefix): value for name, value in definition.constants if name.startswith(prefix)}
    if not named and [each.type for each in definition.fields].count(field.type) == 1:
        named = {name: value for name, value in definition.constants if isinstance(value, int)}
    if field.type in ("bool", "string") or field.type.startswith("float") or field.arity != "one":
        return ""
    return ", ".join(f"{value}: {name}" for name, value in named.items())[:_LONGEST_PROSE]
