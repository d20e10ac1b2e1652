"""PROTOCOL.md agrees with the code: its examples survive a round trip, its tables are those of the code."""

import json
import math
import re
import struct
from pathlib import Path
from typing import Any, get_args, get_type_hints

import msgspec
import pytest

from linked_fleet_agent.long_replies import HELD_S
from linked_fleet_agent.wire import codec, components, keys, messages, schema
from linked_fleet_agent.wire.keys import Keys, RobotKey, escape, unescape
from linked_fleet_agent.wire.parts import PART_BYTES, PartRequest, parse_head, parse_request
from linked_fleet_link.long_replies import LONGEST_BYTES, MAX_TRANSFER_S, PART_TIMEOUT_S, SHORTEST_BYTES

PAGE = (Path(codec.__file__).parent / "PROTOCOL.md").read_text()
KINDS: dict[str, Any] = {
    "description": components.DescriptionWithComponents,
    "command": messages.Command,
    "stop": messages.Stop,
    "progress": messages.Progress,
    "condition": messages.Condition,
    "glance": messages.PictureQuery,
    "values": components.Values,
    "operate": components.Operate,
    "event": components.Occurrence,
    "sample": components.Sample,
}


def examples(language: str) -> list[tuple[str, str]]:
    return re.findall(rf"^```{language} (\w+)\n(.*?)^```$", PAGE, re.M | re.S)


def table(*header: str) -> list[list[str]]:
    """Return the rows of the only table with this header."""
    [body] = re.findall(rf"^\| {re.escape(' | '.join(header))} \|\n\|[-|]+\n((?:\|.*\n)+)", PAGE, re.M)
    return [[cell.strip().strip("`") for cell in line.strip("| \n").split(" | ")] for line in body.splitlines()]


def decoded(kind: str, text: str) -> Any:
    if kind == "reply":
        return codec.decode_reply(text.encode())
    return codec.decode(text.encode(), KINDS[kind])


def test_every_kind_of_message_has_an_example() -> None:
    assert {kind for kind, _ in examples("json")} == {*KINDS, "reply", "state"}
    assert {json.loads(text)["type"] for kind, text in examples("json") if kind == "reply"} == {"accepted", "refused"}
    motions = {json.loads(text)["motion"]["type"] for kind, text in examples("json") if kind == "command"}
    assert motions == {"move", "follow"}


@pytest.mark.parametrize(("kind", "text"), [item for item in examples("json") if item[0] != "state"])
def test_an_example_comes_out_as_it_went_in(kind: str, text: str) -> None:
    assert json.loads(codec.encode(decoded(kind, text))) == json.loads(text)


def test_the_frame_in_hex_is_the_state_beside_it() -> None:
    [(_, dump)] = examples("hex")
    [said] = [json.loads(text) for kind, text in examples("json") if kind == "state"]
    state = codec.decode_state(bytes.fromhex(dump))
    assert codec.encode_state(state) == bytes.fromhex(dump)
    for name, value in said.items():
        found = getattr(state, name)
        if isinstance(found, tuple):
            assert [None if math.isnan(item) else item for item in found] == value
        else:
            assert found == value
    assert said.keys() == set(messages.State.__struct_fields__)


def test_the_description_describes_the_frame() -> None:
    [description] = [decoded(kind, text) for kind, text in examples("json") if kind == "description"]
    assert description.layout == codec.layout(len(description.joints), description.base == "floating")


@pytest.mark.parametrize("floating", [False, True])
@pytest.mark.parametrize("joints", [0, 1, 7])
def test_the_field_table_is_the_layout(joints: int, floating: bool) -> None:
    values = {"n": joints, "b": 13 if floating else 0}
    fields = [
        messages.Field(name, kind, eval(offset, values), eval(count, values))  # type: ignore[arg-type]
        for name, kind, offset, count in table("field", "type", "offset", "count")
        if name != "base" or floating
    ]
    assert tuple(fields) == codec.layout(joints, floating)


def test_the_head_of_a_picture_is_that_of_the_code() -> None:
    fields = table("field", "type", "offset")
    formats = {"char2": "2s", "uint16": "H", "uint64": "Q", "int64": "q", "float64": "d"}
    assert "<" + "".join(formats[type_] for _, type_, _ in fields) == codec.HEADER.format
    assert [name for name, *_ in fields] == ["magic", "version", *codec.PictureHeader._fields]
    offsets = [struct.calcsize("<" + "".join(formats[each] for _, each, _ in fields[:at])) for at in range(len(fields))]
    assert [int(offset) for *_, offset in fields] == offsets


def test_the_refusal_codes_are_those_of_the_code() -> None:
    assert {code for code, _ in table("code", "the command")} == set(get_args(messages.RefusalCode))


def test_the_states_are_those_of_the_code() -> None:
    states = get_args(get_type_hints(messages.Progress)["state"])
    assert {state for state, _ in table("state", "the motion")} == set(states)


def test_the_attachments_of_parts_are_those_of_the_code() -> None:
    (first, _), (reply, _), (later, _) = table("attachment", "of")
    begun, head, asked = (parse_request(first.encode()), parse_head(reply.encode()), parse_request(later.encode()))
    assert begun == PartRequest("", 0, PART_BYTES)
    assert head is not None
    assert asked == PartRequest(head.tag, PART_BYTES, LONGEST_BYTES)
    section = PAGE[PAGE.index("## Parts of a reply") :]
    for number in (PART_BYTES, LONGEST_BYTES, SHORTEST_BYTES):
        assert f"{number:,}" in section
    for number in (PART_TIMEOUT_S, MAX_TRANSFER_S, HELD_S):
        assert f"{number:.0f} s" in section


def test_the_fields_of_a_command_that_have_a_default_are_explained() -> None:
    explained = {field for field, _ in table("field", "meaning")}
    assert explained == {"motion", "scale", "expects", "rehearsal"} <= set(messages.Command.__struct_fields__)


def test_the_key_table_is_what_keys_are_built_from() -> None:
    documented = {row[0] for row in table("key", "kind", "declared or published by", "read by")}
    built = {Keys().robot("ROBOT", kind) for kind in get_args(keys.RobotKind)}
    built |= {Keys().presence("ROBOT", 1).replace("/1", "/{incarnation}")}
    built |= {Keys().gateway("GATEWAY"), Keys().heartbeat("GATEWAY")}
    assert documented == {key.replace("ROBOT", "{robot}").replace("GATEWAY", "{gateway}") for key in built}
    assert {Keys().gateway_of(key.format(gateway="g")) for key in documented if "{gateway}" in key} == {"g"}
    for key in (key for key in documented if "{robot}" in key):
        parsed = Keys().parse(key.replace("{robot}", "r").replace("{incarnation}", "1"))
        assert isinstance(parsed, RobotKey)
        assert parsed.kind in get_args(keys.Kind)


def test_the_examples_of_the_escape_are_true() -> None:
    for name, chunk in table("name", "chunk"):
        assert escape(name) == chunk
        assert unescape(chunk) == name


def test_the_limits_and_counts_of_streams_are_those_of_the_code() -> None:
    limits = {member: float(default) for member, default, _ in table("member of `stream`", "default", "meaning")}
    assert limits == msgspec.structs.asdict(components.StreamLimits())
    counts = {count for count, *_ in table("count", "the sample", "then")}
    assert counts == set(messages.StreamCounts.__struct_fields__) - {"silent"}


def test_the_page_is_of_the_version_that_is_spoken() -> None:
    assert f"\nVersion {messages.COMPONENTS_VERSION}. " in PAGE


def test_the_bounds_are_those_of_the_code() -> None:
    bounds = PAGE[PAGE.rindex("Bounds:") :].replace("\n", " ")
    for number in (
        128,
        codec.MAX_JOINTS,
        256,
        8_000_000,
        65_536,
        1024,
        512,
        1000,
        3600,
        messages.MAX_MESH_BYTES,
        16,
        4096,
        components.MAX_COMPONENTS,
        components.MAX_PROPERTIES,
        components.MAX_ACTIONS,
        components.MAX_DECLARATIONS_BYTES,
        components.MAX_INPUT_BYTES,
        components.MAX_SAMPLE_BYTES,
        components.MAX_VALUE_BYTES,
        schema.MAX_DEPTH,
        schema.MAX_MEMBERS,
        schema.MAX_ITEMS,
        schema.MAX_TEXT,
        schema.MAX_PATTERN,
        schema.MAX_PATTERN_TEXT,
    ):
        assert f"{number}" in bounds or f"{number:,}" in bounds
