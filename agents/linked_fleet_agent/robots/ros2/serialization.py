"""Messages of ROS 2 as bytes: plain CDR, version 1 (OMG DDS-XTypes 1.3, 7.4.3.2), to and from JSON-like values. Pure.

A message is a dict by field; ``uint8``, ``byte`` and ``char`` arrays are bytes. The bytes may come from anybody: each
item of a value takes at least one byte, so a message costs time and memory in proportion to its length.
"""

import struct
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

from linked_fleet_agent.robots.ros2.definitions import (
    FILLER,
    NUMBERS,
    TEXTS,
    Definition,
    DefinitionError,
    Field,
)

MAX_MESSAGE_BYTES = 262_144
"""Longest message, if no other bound is given."""
MAX_NESTING, MAX_LEAST_BYTES = 32, 1_048_576
"""Bounds of a type: how deep it is nested, and the length of its shortest message."""

Read = Callable[[bytes, int], tuple[Any, int]]
Write = Callable[[bytearray, Any], None]
_LITTLE, _BIG = b"\x00\x01", b"\x00\x00"
_OTHER_ENCODINGS = {2: "a parameter list", 3: "a parameter list"}
_OCTETS = ("uint8", "byte", "char")


class CdrError(ValueError):
    """The bytes are not the expected message, or a value is none that it can have; the text says why."""


class Codec(NamedTuple):
    """Functions that read and write one type in one byte order, its zero value and its least length."""

    read: Read
    write: Write
    zero: Callable[[], Any]
    least: int


class Serializer:
    """The codecs of the types of some definitions, made when they are needed first."""

    def __init__(self, definitions: Mapping[str, Definition]) -> None:
        self._definitions = definitions
        self._codecs = dict[tuple[str, str], Codec]()

    def read(self, payload: bytes, name: str, most_bytes: int = MAX_MESSAGE_BYTES) -> dict[str, Any]:
        """Return the message in ``payload``. Raises CdrError, and DefinitionError for a type that cannot be used."""
        if len(payload) > most_bytes:
            raise CdrError(f"{len(payload)} bytes are too many; a {name} may have {most_bytes}")
        head = payload[:2]
        if len(payload) < 4 or head not in (_LITTLE, _BIG):
            raise CdrError(_head_problem(payload))
        codec = self._codec(name, "<" if head == _LITTLE else ">")
        body = payload[4:]
        try:
            value, end = codec.read(body, 0)
        except struct.error as error:
            raise CdrError(f"it ends early: {len(payload)} bytes are too few for this {name}") from error
        if end + 3 < len(body):  # as much as a padding to four bytes
            raise CdrError(f"{len(body) - end} bytes follow the end of the {name}")
        assert isinstance(value, dict)
        return value

    def write(self, value: Mapping[str, Any], name: str) -> bytes:
        """Return the bytes of a message, little-endian. Members that ``value`` lacks have their defaults.

        Raises CdrError for a value that the type cannot have, and DefinitionError for a type that cannot be used.
        """
        out = bytearray()
        self._codec(name, "<").write(out, value)
        return _LITTLE + b"\x00\x00" + bytes(out)

    def zero(self, name: str) -> Any:
        """Return a message of defaults. Raises DefinitionError for a type that cannot be used."""
        return self._codec(name, "<").zero()

    def _codec(self, name: str, order: str, above: tuple[str, ...] = ()) -> Codec:
        found = self._codecs.get((name, order))
        if found is None:
            if name in above or len(above) >= MAX_NESTING:
                raise DefinitionError(f"{(*above, name)[0]} is nested more than {MAX_NESTING} deep, or contains itself")
            found = self._codecs[name, order] = self._struct(self._definitions[name], order, (*above, name))
        return found

    def _struct(self, definition: Definition, order: str, above: tuple[str, ...]) -> Codec:
        codecs = [(field, self._field(field, order, above)) for field in definition.fields]
        least = sum(codec.least for _, codec in codecs)
        if least > MAX_LEAST_BYTES:
            raise DefinitionError(f"a {definition.name} has at least {least} bytes; {MAX_LEAST_BYTES} is the maximum")
        said = [(field.name, codec) for field, codec in codecs if field.name != FILLER]
        names = frozenset(name for name, _ in said)
        reads = [(field.name, codec.read) for field, codec in codecs]
        filled = len(said) < len(codecs)

        def read(data: bytes, at: int) -> tuple[Any, int]:
            value = {}
            for name, read_field in reads:
                value[name], at = read_field(data, at)
            if filled:
                del value[FILLER]
            return value, at

        def write(out: bytearray, value: Any) -> None:
            if not isinstance(value, Mapping):
                raise CdrError(f"{_shown(value)} is not an object")
            if stray := value.keys() - names:
                raise CdrError(
                    f"{min(map(str, stray))!r} is unknown; the members are {', '.join(sorted(names)) or 'none'}"
                )
            if filled:
                out.append(0)
            for name, codec in said:
                try:
                    codec.write(out, value[name] if name in value else codec.zero())
                except CdrError as error:
                    raise CdrError(f"{name}: {error}") from error

        return Codec(read, write, lambda: {name: codec.zero() for name, codec in said}, least)

    def _field(self, field: Field, order: str, above: tuple[str, ...]) -> Codec:
        codec = self._value(field, order, above)
        if field.default is None:
            return codec
        try:
            codec.write(bytearray(), field.default)
        except CdrError as error:
            raise DefinitionError(f"the default of {field.name} is none of its values: {error}") from error
        return codec._replace(zero=lambda: field.default)

    def _value(self, field: Field, order: str, above: tuple[str, ...]) -> Codec:
        if field.type in TEXTS or field.type == "wchar":
            if field.type != "string":
                raise DefinitionError(f"{field.name} is a {field.type}, which implementations of ROS write differently")
            item = _text(field, order)
        elif field.type in NUMBERS:
            if field.arity == "one":
                return _number(field, order)
            return _numbers(field, order)
        else:
            item = self._codec(field.type, order, above)
        return item if field.arity == "one" else _items(field, item, order)


def _head_problem(payload: bytes) -> str:
    if len(payload) < 4:
        return f"{len(payload)} bytes are no message; it begins with four bytes that name its encoding"
    number = int.from_bytes(payload[:2])
    named = _OTHER_ENCODINGS.get(number, "XCDR2" if 6 <= number <= 0x0B else "unknown")
    return f"the encoding {number:#06x} is {named}; plain CDR (0x0000 or 0x0001) is expected"


def _shown(value: Any) -> str:
    return f"{value!r:.60}"


def _number(field: Field, order: str) -> Codec:
    code = NUMBERS[field.type]
    packed = struct.Struct(order + code)
    size, unpack, real = packed.size, packed.unpack_from, code in "fd"

    def read(data: bytes, at: int) -> tuple[Any, int]:
        at = (at + size - 1) & -size
        return unpack(data, at)[0], at + size

    def write(out: bytearray, value: Any) -> None:
        out += bytes(-len(out) % size)
        out += _packed(packed, field.type, value)

    return Codec(read, write, lambda: False if code == "?" else 0.0 if real else 0, size)


def _packed(packed: struct.Struct, type_: str, *values: Any) -> bytes:
    for value in values:
        if isinstance(value, bool) != (type_ == "bool") or not isinstance(value, int | float):
            raise CdrError(f"{_shown(value)} is no {type_}")
    if not type_.startswith("float"):  # JSON does not tell 1.0 from 1
        values = tuple(int(each) if isinstance(each, float) and each.is_integer() else each for each in values)
    try:
        return packed.pack(*values)
    except (struct.error, OverflowError) as error:
        raise CdrError(f"{_shown(values[0] if len(values) == 1 else list(values))} is no {type_}: {error}") from error


def _text(field: Field, order: str) -> Codec:
    length = struct.Struct(order + "I")

    def read(data: bytes, at: int) -> tuple[Any, int]:
        at = ((at + 3) & -4) + 4
        count = length.unpack_from(data, at - 4)[0]
        if count > len(data) - at:
            raise struct.error
        _check_count(count - 1, field.text_size, "bytes")
        try:
            return data[at : at + max(count - 1, 0)].decode(), at + count
        except UnicodeDecodeError as error:
            raise CdrError(f"{field.name} is not text in UTF-8") from error

    def write(out: bytearray, value: Any) -> None:
        try:
            said = value.encode()
        except (AttributeError, UnicodeEncodeError) as error:
            raise CdrError(f"{_shown(value)} is not a text") from error
        if b"\x00" in said:
            raise CdrError(f"{_shown(value)} has a NUL, which ends texts of ROS")
        _check_count(len(said), field.text_size, "bytes")
        out += bytes(-len(out) % 4)
        out += length.pack(len(said) + 1) + said + b"\x00"

    return Codec(read, write, str, 4)


def _check_count(count: int, most: int, things: str) -> None:
    if most and count > most:
        raise CdrError(f"{count} {things} are too many; {most} is the maximum")


def _counter(field: Field, least: int, order: str) -> tuple[Read, Write, int]:
    """Return how the number of items is read and written, which a fixed array does not state, and its length.

    An item has at least ``least`` bytes.
    """
    if field.arity == "array":

        def check(_: bytearray, count: Any) -> None:
            if count != field.size:
                raise CdrError(f"{count} items, where {field.size} are expected")

        return (lambda _, at: (field.size, at)), check, 0
    packed = struct.Struct(order + "I")

    def read(data: bytes, at: int) -> tuple[Any, int]:
        at = (at + 3) & -4
        count = packed.unpack_from(data, at)[0]
        _check_count(count, field.size if field.arity == "bounded" else 0, "items")
        if count * least > len(data) - at - 4:
            raise struct.error
        return count, at + 4

    def write(out: bytearray, count: Any) -> None:
        _check_count(count, field.size if field.arity == "bounded" else 0, "items")
        out += bytes(-len(out) % 4)
        out += packed.pack(count)

    return read, write, 4


def _numbers(field: Field, order: str) -> Codec:
    code = NUMBERS[field.type]
    size, octets = struct.calcsize(f"={code}"), field.type in _OCTETS
    read_count, write_count, counted = _counter(field, size, order)

    def read(data: bytes, at: int) -> tuple[Any, int]:
        count, at = read_count(data, at)
        if not count:
            return (b"" if octets else []), at
        at = (at + size - 1) & -size
        end = at + count * size
        if end > len(data):
            raise struct.error
        return (data[at:end] if octets else list(struct.unpack_from(f"{order}{count}{code}", data, at))), end

    def write(out: bytearray, value: Any) -> None:
        if not isinstance(value, list | tuple | bytes):
            raise CdrError(f"{_shown(value)} is not an array")
        write_count(out, len(value))
        if value:
            out += bytes(-len(out) % size)
            out += (
                value
                if octets and isinstance(value, bytes)
                else _packed(struct.Struct(f"{order}{len(value)}{code}"), field.type, *value)
            )

    fixed = field.size if field.arity == "array" else 0
    empty: Any = bytes(fixed) if octets else [False if code == "?" else 0] * fixed
    return Codec(read, write, lambda: empty, counted + fixed * size)


def _items(field: Field, item: Codec, order: str) -> Codec:
    read_count, write_count, counted = _counter(field, item.least, order)

    def read(data: bytes, at: int) -> tuple[Any, int]:
        count, at = read_count(data, at)
        items = []
        for _ in range(count):
            value, at = item.read(data, at)
            items.append(value)
        return items, at

    def write(out: bytearray, value: Any) -> None:
        if not isinstance(value, list | tuple):
            raise CdrError(f"{_shown(value)} is not an array")
        write_count(out, len(value))
        for index, each in enumerate(value):
            try:
                item.write(out, each)
            except CdrError as error:
                raise CdrError(f"item {index}: {error}") from error

    fixed = field.size if field.arity == "array" else 0
    return Codec(read, write, lambda: [item.zero() for _ in range(fixed)], counted + fixed * item.least)
