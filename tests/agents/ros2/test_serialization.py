"""Bytes of messages of any type, compared with those of rosbags, and what is refused."""

import dataclasses
import struct
from random import Random
from typing import Any

import numpy as np
import pytest

from linked_fleet_agent.robots.ros2.definitions import FILLER, NUMBERS, Field
from linked_fleet_agent.robots.ros2.serialization import CdrError
from linked_fleet_agent.robots.ros2.types import MessageType, MessageTypes
from ros2_robot import STORE

TYPES = MessageTypes(preferred="kilted")  # as the store of the stand-in
NAMES = [each for each in STORE.fielddefs if each.split("/")[1] == "msg"]
_RANGES = {f"{sign}int{bits}": bits for sign in ("", "u") for bits in (8, 16, 32, 64)}


def random_message(random: Random, type_: MessageType) -> dict[str, Any]:
    fields = [field for field in type_.fields if field.name != FILLER]
    return {field.name: _random_field(random, type_, field) for field in fields}


def _random_field(random: Random, type_: MessageType, field: Field) -> Any:
    if field.arity == "one":
        return _random_item(random, type_, field)
    count = field.size if field.arity == "array" else random.randint(0, min(field.size or 3, 3))
    items = [_random_item(random, type_, field) for _ in range(count)]
    return bytes(items) if field.type in ("uint8", "byte", "char") else items


def _random_item(random: Random, type_: MessageType, field: Field) -> Any:
    if field.type == "string":
        return random.choice(("", "a", "joint_1", "\u00e4\u00f6\u00fc", "x" * random.randrange(9)))
    if field.type == "bool":
        return random.random() < 0.5
    if field.type.startswith("float"):
        value = random.choice((0.0, -1.5, 1e9, float("inf"), random.uniform(-9, 9)))
        return struct.unpack("f", struct.pack("f", value))[0] if field.type == "float32" else value
    if field.type in NUMBERS:
        bits = _RANGES.get(field.type, 7)  # a byte of rosbags has a sign, that of ROS has none
        return random.getrandbits(bits) - (0 if field.type[0] in "ubc" else 2 ** (bits - 1))
    return random_message(random, dataclasses.replace(type_, name=field.type))


def _of_rosbags(value: Any, name: str) -> Any:
    """Return a message of rosbags with the same content."""
    said = dict(value)
    for field, (node, about) in STORE.fielddefs[name][1]:
        if field == FILLER:
            said[field] = 0
        elif node == 2:
            said[field] = _of_rosbags(said[field], about)
        elif node != 1 and about[0][0] == 2:
            said[field] = [_of_rosbags(each, about[0][1]) for each in said[field]]
        elif node != 1 and about[0][1][0] != "string":
            kind = {"byte": "uint8", "char": "uint8"}.get(about[0][1][0], about[0][1][0])
            said[field] = np.array(list(said[field]), dtype=kind)
    return STORE.types[name](**said)


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("little_endian", [True, False])
def test_every_message_is_written_and_read_as_rosbags_does(name: str, little_endian: bool) -> None:
    type_, random = TYPES.message(name), Random(name)
    for _ in range(5):
        value = random_message(random, type_)
        payload = bytes(STORE.serialize_cdr(_of_rosbags(value, name), name, little_endian=little_endian))
        assert type_.read(payload) == value
        if little_endian:
            assert type_.write(value) == payload


STATUS = TYPES.message("diagnostic_msgs/msg/DiagnosticStatus")
GOOD = STATUS.write({"level": 1, "name": "arm", "values": [{"key": "k", "value": "v"}]})


@pytest.mark.parametrize("end", range(len(GOOD)))
def test_a_truncated_message_is_refused(end: int) -> None:
    with pytest.raises(CdrError):
        STATUS.read(GOOD[:end])


@pytest.mark.parametrize(
    ("payload", "said"),
    [
        (b"", "0 bytes are no message"),
        (b"\0\3" + GOOD[2:], "the encoding 0x0003 is a parameter list; plain CDR"),
        (b"\0\7" + GOOD[2:], "the encoding 0x0007 is XCDR2"),
        (b"\1\0" + GOOD[2:], "the encoding 0x0100 is unknown"),
        (GOOD + bytes(4), "4 bytes follow the end"),
        (bytes(262_145), "262145 bytes are too many; a diagnostic_msgs/msg/DiagnosticStatus may have 262144"),
        (GOOD[:8] + b"\xff\xff\xff\xff" + GOOD[12:], "it ends early"),
        (GOOD.replace(b"arm", b"\xff\xfe\xfd"), "name is not text in UTF-8"),
    ],
)
def test_what_is_no_message_is_refused_with_a_reason(payload: bytes, said: str) -> None:
    with pytest.raises(CdrError) as refused:
        STATUS.read(payload)
    assert said in str(refused.value)


@pytest.mark.parametrize("padding", [0, 1, 2, 3])
def test_padding_to_four_bytes_may_follow(padding: int) -> None:
    assert STATUS.read(GOOD + bytes(padding))["name"] == "arm"


@pytest.mark.parametrize(
    ("value", "said"),
    [
        ({"colour": 1}, "'colour' is unknown; the members are hardware_id, level, message, name, values"),
        ({"level": 256}, "level: 256 is no byte"),
        ({"level": True}, "level: True is no byte"),
        ({"level": 0.5}, "level: 0.5 is no byte"),
        ({"level": None}, "level: None is no byte"),
        ({"name": 1}, "name: 1 is not a text"),
        ({"name": "a\0b"}, "has a NUL"),
        ({"name": "\ud800"}, "is not a text"),
        ({"values": {}}, "values: {} is not an array"),
        ({"values": [{"key": "a"}, {"key": 2}]}, "values: item 1: key: 2 is not a text"),
        ({"values": [[]]}, "values: item 0: [] is not an object"),
    ],
)
def test_a_value_that_the_type_cannot_have_is_refused_with_its_place(value: dict[str, Any], said: str) -> None:
    with pytest.raises(CdrError) as refused:
        STATUS.write(value)
    assert said in str(refused.value)


def test_numbers_of_json_are_integers_where_they_are_whole() -> None:
    assert TYPES.message("std_msgs/msg/Int32").write({"data": 3.0}) == b"\0\1\0\0\3\0\0\0"
    with pytest.raises(CdrError, match="data: 1e\\+300 is no float32"):
        TYPES.message("std_msgs/msg/Float32").write({"data": 1e300})


@pytest.mark.parametrize(("count", "good"), [(36, True), (35, False), (37, False)])
def test_a_fixed_array_has_its_length(count: int, good: bool) -> None:
    pose = TYPES.message("geometry_msgs/msg/PoseWithCovariance")
    if good:
        assert pose.read(pose.write({"covariance": [0.5] * count}))["covariance"] == [0.5] * count
    else:
        with pytest.raises(CdrError, match=f"covariance: {count} items, where 36 are expected"):
            pose.write({"covariance": [0.5] * count})


def test_a_bounded_sequence_has_its_maximum() -> None:
    primitive = TYPES.message("shape_msgs/msg/SolidPrimitive")
    with pytest.raises(CdrError, match="dimensions: 4 items are too many; 3 is the maximum"):
        primitive.write({"dimensions": [1.0] * 4})
    payload = bytearray(primitive.write({"type": 1, "dimensions": [1.0] * 3, "polygon": {}}))
    assert payload[8:12] == b"\3\0\0\0"
    payload[8] = 4
    with pytest.raises(CdrError, match="4 items are too many; 3 is the maximum"):
        primitive.read(bytes(payload))


def test_a_message_without_fields_is_one_byte_as_in_ros() -> None:
    empty = TYPES.message("std_msgs/msg/Empty")
    assert empty.write({}) == b"\0\1\0\0\0"
    assert empty.read(b"\0\1\0\0\0\0\0\0") == {}


KINDS = MessageTypes().describe(
    {
        "type_description": {
            "type_name": "my_msgs/msg/Kinds",
            "fields": [
                {"name": name, "default_value": "",
                 "type": {"type_id": number, "capacity": size, "string_capacity": text, "nested_type_name": ""}}
                for name, number, size, text in (
                    ("flag", 15, 0, 0), ("reals", 58, 2, 0), ("small", 2, 0, 0), ("halves", 52, 2, 0),
                    ("flags", 63, 2, 0), ("big", 59, 1, 0), ("octets", 51, 3, 0), ("letters", 61, 1, 0),
                    ("word", 21, 0, 4), ("few", 104, 2, 0), ("many", 159, 0, 0), ("bytes", 160, 0, 0),
                    ("real", 11, 0, 0),
                )
            ],
        },
        "referenced_type_descriptions": [],
    }
)  # fmt: skip
VALUE = {
    "flag": True, "reals": [0.5, 1.0], "small": -1, "halves": [1, -2], "flags": [False, True], "big": [1.5],
    "octets": b"\1\2\3", "letters": b"c", "word": "abcd", "few": [7], "many": [True], "bytes": b"xy", "real": -0.5,
}  # fmt: skip
WRITTEN = bytes.fromhex(
    "00010000"
    "01 000000 0000003f 0000803f"  # a bool, and floats aligned to 4
    "ff 00 0100 feff"  # at 12: an int8, and int16 aligned to 2
    "00 01 00000000"  # at 18: bools, and padding to 8
    "000000000000f83f"  # at 24: a double
    "010203 63"  # at 32: octets and a char
    "05000000 6162636400 000000"  # at 36: four letters with their NUL, padded
    "01000000 00000000 0700000000000000"  # at 48: one int64, aligned to 8
    "01000000 01 000000"  # at 64: one bool, padded
    "02000000 7879 0000"  # at 72: two bytes, padded to 80
    "000000000000e0bf"
)


def test_every_kind_of_field_is_aligned_to_its_size() -> None:
    assert KINDS.write(VALUE) == WRITTEN
    assert KINDS.read(WRITTEN) == VALUE
    assert KINDS.write({**VALUE, "octets": [1, 2, 3], "bytes": [120, 121]}) == WRITTEN


def test_what_is_left_out_is_zero() -> None:
    zero = KINDS.read(KINDS.write({}))
    assert zero == {
        "flag": False, "reals": [0.0, 0.0], "small": 0, "halves": [0, 0], "flags": [False, False], "big": [0.0],
        "octets": bytes(3), "letters": b"\0", "word": "", "few": [], "many": [], "bytes": b"", "real": 0.0,
    }  # fmt: skip
    assert KINDS.origin.serializer.zero(KINDS.name) == zero


@pytest.mark.parametrize(
    ("field", "value", "said"),
    [
        ("word", "abcde", "word: 5 bytes are too many; 4 is the maximum"),
        ("few", [1, 2, 3], "few: 3 items are too many; 2 is the maximum"),
        ("flags", [True], "flags: 1 items, where 2 are expected"),
        ("flags", [True, 2], "flags: 2 is no bool"),
        ("halves", [1, 40_000], "halves: [1, 40000] is no int16"),
        ("octets", "abc", "octets: 'abc' is not an array"),
        ("small", -129, "small: -129 is no int8"),
    ],
)
def test_the_bounds_of_fields_are_kept(field: str, value: Any, said: str) -> None:
    with pytest.raises(CdrError) as refused:
        KINDS.write({**VALUE, field: value})
    assert str(refused.value).startswith(said)


@pytest.mark.parametrize(
    ("at", "count", "said"),
    [
        (40, 6, "5 bytes are too many; 4 is the maximum"),
        (52, 3, "3 items are too many; 2 is the maximum"),
        (40, 2**32 - 1, "it ends early"),
        (76, 2**31, "it ends early"),
        (76, 13, "it ends early"),
    ],
)
def test_counts_that_cannot_be_are_refused(at: int, count: int, said: str) -> None:
    payload = bytearray(WRITTEN)
    struct.pack_into("<I", payload, at, count)
    with pytest.raises(CdrError, match=said):
        KINDS.read(bytes(payload))


def test_a_message_of_exactly_the_maximum_is_read() -> None:
    assert KINDS.read(WRITTEN, len(WRITTEN)) == VALUE
    with pytest.raises(CdrError, match="are too many"):
        KINDS.read(WRITTEN, len(WRITTEN) - 1)
