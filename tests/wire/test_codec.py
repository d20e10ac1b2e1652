"""Bytes ↔ messages: round trips, versions, and every malformed payload refused as a WireError and nothing else."""

import contextlib
import json
import math
import struct
from typing import Any

import msgspec
import numpy
import pytest
from hypothesis import given
from hypothesis import strategies as st

from agents.wire import codec
from agents.wire.codec import MAX_JOINTS, VersionError, WireError
from agents.wire.messages import (
    WIRE_VERSION,
    Accepted,
    Base,
    Command,
    Description,
    Expectation,
    Follow,
    Move,
    Progress,
    Refused,
    State,
    Stop,
)

KINDS: tuple[Any, ...] = (Description, Command, Stop, Progress)
measured = st.floats(allow_infinity=False)
three, four = st.tuples(*[measured] * 3), st.tuples(*[measured] * 4)
bases = st.builds(Base, three, four, three, three)


@st.composite
def states(draw: st.DrawFn) -> State:
    joints = draw(st.integers(0, 12))
    row = st.lists(measured, min_size=joints, max_size=joints).map(tuple)
    return State(
        incarnation=draw(st.integers(0, 2**63 - 1)),
        sequence=draw(st.integers(0, 2**64 - 1)),
        monotonic_ns=draw(st.integers(0, 2**63 - 1)),
        wall_ns=draw(st.integers(0, 2**63 - 1)),
        base=draw(st.none() | bases),
        positions=draw(row),
        velocities=draw(row),
        efforts=draw(row),
    )


def frame(joints: int = 2, *, floating: bool = False, value: float = 0.5) -> bytes:
    base = Base((value,) * 3, (value,) * 4, (value,) * 3, (value,) * 3) if floating else None
    row = (value,) * joints
    return codec.encode_state(
        State(
            incarnation=1, sequence=2, monotonic_ns=3, wall_ns=4, base=base, positions=row, velocities=row, efforts=row
        )
    )


def command(**changes: object) -> dict[str, object]:
    whole: dict[str, object] = {
        "version": WIRE_VERSION,
        "id": "a-1",
        "incarnation": 1,
        "seen_ns": 2,
        "time_to_live_ns": 3,
        "motion": {"type": "move", "targets": {"hinge": 0.5}},
    }
    return whole | changes


DESCRIPTION = Description(
    version=WIRE_VERSION,
    robot="door",
    incarnation=1,
    title="Door",
    urdf="<robot/>",
    joints=("hinge",),
    rate_hz=100.0,
    layout=codec.layout(1, False),
)


class TestState:
    @given(states())
    def test_a_frame_comes_back_to_the_bit(self, state: State) -> None:
        payload = codec.encode_state(state)
        again = codec.decode_state(payload)
        assert codec.encode_state(again) == payload
        assert (again.incarnation, again.sequence) == (state.incarnation, state.sequence)
        assert (again.monotonic_ns, again.wall_ns) == (state.monotonic_ns, state.wall_ns)
        assert repr(again.base) == repr(state.base)  # repr: NaN differs from itself

    @given(states())
    def test_numpy_decodes_a_frame_by_its_layout(self, state: State) -> None:
        """Desideratum D5: the described layout suffices to read the binary state, without this code."""
        fields = codec.layout(len(state.positions), state.base is not None)
        kinds = {"char2": "S2", "uint16": "<u2", "uint64": "<u8", "int64": "<i8", "float64": "<f8"}
        described = numpy.dtype(
            {
                "names": [field.name for field in fields],
                "formats": [(kinds[field.type], (field.count,)) for field in fields],
                "offsets": [field.offset for field in fields],
            }
        )
        payload = codec.encode_state(state)
        assert described.itemsize == len(payload)
        [record] = numpy.frombuffer(payload, described)
        assert record["magic"] == b"LF"
        assert (record["version"], record["joints"]) == (WIRE_VERSION, len(state.positions))
        assert (record["incarnation"], record["sequence"]) == (state.incarnation, state.sequence)
        for name in ("positions", "velocities", "efforts"):
            numpy.testing.assert_array_equal(record[name], getattr(state, name))
        if state.base is not None:
            base = state.base
            values = base.position_m + base.orientation_xyzw + base.linear_m_s + base.angular_rad_s
            numpy.testing.assert_array_equal(record["base"], values)

    def test_an_unknown_value_stays_unknown(self) -> None:
        assert all(math.isnan(value) for value in codec.decode_state(frame(value=math.nan)).efforts)

    @pytest.mark.parametrize("version", [0, WIRE_VERSION + 1, 65_535])
    def test_another_version_is_refused_by_its_number(self, version: int) -> None:
        payload = bytearray(frame())
        struct.pack_into("<H", payload, 2, version)
        with pytest.raises(VersionError, match=f"version {version} is not spoken here; 1 to {WIRE_VERSION} are"):
            codec.decode_state(bytes(payload))

    @pytest.mark.parametrize("floating", [False, True])
    def test_every_truncation_is_refused(self, floating: bool) -> None:
        payload = frame(floating=floating)
        for length in range(len(payload)):
            with pytest.raises(WireError):
                codec.decode_state(payload[:length])

    @pytest.mark.parametrize("value", [math.inf, -math.inf])
    @pytest.mark.parametrize("floating", [False, True])
    def test_an_infinite_value_is_refused(self, value: float, floating: bool) -> None:
        with pytest.raises(WireError, match="infinite"):
            codec.decode_state(frame(value=value, floating=floating))

    @pytest.mark.parametrize(
        ("offset", "field", "text"),
        [
            (0, b"XX", "header"),
            (4, b"\x02\x00", "flags 0x2"),
            (4, b"\x01\x00", "announces"),
            (6, b"\x03\x00", "announces"),
            (6, b"\xff\xff", "65535 joints"),
            (14, b"\x00\x80", "out of range"),  # the incarnation and the two times, with their highest bit
            (30, b"\x00\x80", "out of range"),
            (38, b"\x00\x80", "out of range"),
        ],
    )
    def test_a_header_that_is_not_true_is_refused(self, offset: int, field: bytes, text: str) -> None:
        payload = bytearray(frame())
        payload[offset : offset + 2] = field
        with pytest.raises(WireError, match=text):
            codec.decode_state(bytes(payload))

    def test_more_than_the_frame_is_refused(self) -> None:
        with pytest.raises(WireError, match="announces"):
            codec.decode_state(frame() + b"\x00")

    def test_the_largest_frame_is_taken_and_a_larger_never_made(self) -> None:
        assert len(codec.decode_state(frame(MAX_JOINTS)).positions) == MAX_JOINTS
        with pytest.raises(WireError, match="at most 1024"):
            frame(MAX_JOINTS + 1)

    @given(st.binary(max_size=200) | st.binary(max_size=200).map(lambda rest: b"LF\x01\x00" + rest))
    def test_noise_is_refused_or_a_frame(self, payload: bytes) -> None:
        with contextlib.suppress(WireError):
            codec.decode_state(payload)

    @given(st.data())
    def test_a_damaged_frame_is_refused_or_a_frame(self, data: st.DataObject) -> None:
        payload = bytearray(frame(floating=data.draw(st.booleans())))
        for index in data.draw(st.lists(st.integers(0, len(payload) - 1), min_size=1, max_size=4)):
            payload[index] = data.draw(st.integers(0, 255))
        with contextlib.suppress(WireError):
            codec.decode_state(bytes(payload))


class TestMessages:
    @pytest.mark.parametrize(
        "message",
        [
            DESCRIPTION,
            Command(version=1, id="a", incarnation=1, seen_ns=0, time_to_live_ns=1, motion=Move({"hinge": -0.5})),
            Command(
                version=1,
                id="a",
                incarnation=1,
                seen_ns=0,
                time_to_live_ns=1,
                motion=Follow(("a", "b"), (0.5, 1.0), ((1.0, 2.0), (0.0, -1.0))),
                scale=0.25,
                expects={"a": Expectation(0.5, 0.0)},
                rehearsal=True,
            ),
            Stop(version=1, id="s", joints=("hinge",), command="a", reason="enough", rehearsal=True),
            Stop(version=1, id="s"),
            Progress(version=1, id="a", incarnation=1, state="running", wall_ns=5),
            Progress(
                version=1, id="a", incarnation=1, state="failed", wall_ns=5, reason="stuck", positions={"hinge": 1.0}
            ),
        ],
    )
    def test_a_message_comes_back(self, message: Any) -> None:
        assert codec.decode(codec.encode(message), type(message)) == message

    @pytest.mark.parametrize(
        "reply", [Accepted("a-1"), Accepted("a-1", 1.5, ("b", "c"), 2**63 - 1), Refused("", "malformed", "not JSON")]
    )
    def test_a_reply_comes_back(self, reply: Accepted | Refused) -> None:
        assert codec.decode_reply(codec.encode(reply)) == reply

    @pytest.mark.parametrize("kind", KINDS)
    @pytest.mark.parametrize("version", [-1, 0, WIRE_VERSION + 1])
    def test_another_version_is_refused_before_anything_else_is_judged(self, version: int, kind: Any) -> None:
        payload = json.dumps({"version": version, "of": "another time"}).encode()
        with pytest.raises(VersionError, match=f"version {version} is not spoken here"):
            codec.decode(payload, kind)

    @pytest.mark.parametrize(
        "changes",
        [
            {"id": ""},
            {"id": "a" * 65},
            {"id": "a b"},
            {"id": "a\n"},
            {"incarnation": -1},
            {"incarnation": 2**63},
            {"seen_ns": None},
            {"time_to_live_ns": 0},
            {"time_to_live_ns": 60_000_000_001},
            {"motion": {"type": "move", "targets": {}}},
            {"motion": {"type": "move", "targets": {"": 0.0}}},
            {"motion": {"type": "move", "targets": {"hinge": None}}},
            {"motion": {"type": "move", "targets": {"hinge": "0.5"}}},
            {"motion": {"type": "move", "targets": {f"j{i}": 0.0 for i in range(257)}}},
            {"motion": {"type": "jump", "targets": {"hinge": 0.0}}},
            {"motion": {"type": "move", "targets": {"hinge": 0.0}, "unless": "a person is near"}},
            {"unless": "a person is near"},
            {"motion": {"type": "move", "targets": {"hinge": 0.0}, "speeds": {"hinge": 0.0}}},
            {"motion": {"type": "follow", "joints": [], "times_s": [1.0], "positions": [[]]}},
            {"motion": {"type": "follow", "joints": ["hinge"], "times_s": [0.0], "positions": [[0.0]]}},
            {"motion": {"type": "follow", "joints": ["hinge"], "times_s": [3601.0], "positions": [[0.0]]}},
            {"motion": {"type": "follow", "joints": ["hinge"], "times_s": [1.0] * 1001, "positions": [[0.0]]}},
            {"motion": {"type": "follow", "joints": ["hinge"], "times_s": [1.0], "positions": [[None]]}},
            {"scale": 0.0},
            {"scale": 1.01},
            {"expects": {"hinge": {"position": 0.0}}},
            {"expects": {"hinge": {"position": 0.0, "tolerance": -0.1}}},
            {"rehearsal": "no"},
            {"version": "1"},
            {"version": True},
        ],
    )
    def test_a_command_out_of_bounds_is_refused(self, changes: dict[str, object]) -> None:
        codec.decode(json.dumps(command()).encode(), Command)
        with pytest.raises(WireError):
            codec.decode(json.dumps(command(**changes)).encode(), Command)

    @pytest.mark.parametrize(
        "changes",
        [
            {"id": ""},
            {"joints": None},
            {"joints": [""]},
            {"joints": ["j"] * 1025},
            {"command": "x" * 65},
            {"reason": "x" * 513},
            {"gently": True},
        ],
    )
    def test_a_stop_out_of_bounds_is_refused(self, changes: dict[str, object]) -> None:
        whole = {"version": 1, "id": "s"}
        codec.decode(json.dumps(whole).encode(), Stop)
        with pytest.raises(WireError):
            codec.decode(json.dumps(whole | changes).encode(), Stop)

    @pytest.mark.parametrize("number", ["-1", "9223372036854775808", "123456789012345678901234567890", "1.5", "1e30"])
    def test_what_is_no_time_is_refused(self, number: str) -> None:
        """Below zero, or beyond 63 bits, it is none that a calendar has."""
        told = Progress(version=1, id="a", incarnation=1, state="succeeded", wall_ns=2**63 - 1)
        payload = codec.encode(told)
        assert codec.decode(payload, Progress) == told
        with pytest.raises(WireError, match="wall_ns"):
            codec.decode(payload.replace(b"9223372036854775807", number.encode()), Progress)
        accepted = codec.encode(Accepted("a", at_ns=5))
        assert codec.decode_reply(accepted) == Accepted("a", at_ns=5)
        with pytest.raises(WireError, match="at_ns"):
            codec.decode_reply(accepted.replace(b'"at_ns":5', b'"at_ns":' + number.encode()))

    @pytest.mark.parametrize("number", ["NaN", "Infinity", "-Infinity", "1e999", "-1e999"])
    def test_a_target_that_is_no_number_is_refused(self, number: str) -> None:
        payload = json.dumps(command()).replace("0.5", number).encode()
        with pytest.raises(WireError):
            codec.decode(payload, Command)

    @pytest.mark.parametrize(
        "changes",
        [
            {"robot": ""},
            {"robot": "x" * 129},
            {"rate_hz": 0},
            {"rate_hz": 10_001},
            {"base": "loose"},
            {"joints": [f"j{index}" for index in range(MAX_JOINTS + 1)]},
            {"layout": [{"name": "x", "type": "float64", "offset": 0, "count": 1}] * 65},
            {"layout": [{"name": "x", "type": "complex", "offset": 0, "count": 1}]},
            {"urdf": "x" * 8_000_001},
            {"annotations": "x" * 65_537},
        ],
    )
    def test_a_description_out_of_bounds_is_refused(self, changes: dict[str, object]) -> None:
        whole = msgspec.to_builtins(DESCRIPTION)
        with pytest.raises(WireError):
            codec.decode(json.dumps(whole | changes).encode(), Description)

    @pytest.mark.parametrize("kind", [Description, Progress])
    def test_an_unknown_field_of_news_is_ignored(self, kind: Any) -> None:
        message = (
            DESCRIPTION
            if kind is Description
            else Progress(version=1, id="a", incarnation=1, state="running", wall_ns=5)
        )
        payload = json.dumps(msgspec.to_builtins(message) | {"weather": "fine"}).encode()
        assert codec.decode(payload, kind) == message

    @pytest.mark.parametrize(
        "payload",
        [
            b"",
            b"\xff\xfe",
            b'"\xff"',
            b"null",
            b"[]",
            b"{}",
            b'{"version":',
            b'{"version":1}{}',
            b'{"version":1e999}',
            b'{"version":' + b"9" * 5000 + b"}",
            b"[" * 100_000,
            b'{"version":1,"x":' + b"[" * 100_000,
            b'{"type":"accepted","id":"a","x":' + b"[" * 100_000,
            b'{"type":"accepted","id":"\\ud800"}',
            b'{"version":1,"id":"\\ud800"}',
        ],
    )
    def test_what_is_no_message_is_refused(self, payload: bytes) -> None:
        for kind in KINDS:
            with pytest.raises(WireError):
                codec.decode(payload, kind)
        with pytest.raises(WireError):
            codec.decode_reply(payload)

    @given(
        st.binary(max_size=300)
        | st.recursive(
            st.none() | st.booleans() | st.integers() | st.floats() | st.text(),
            lambda inner: (
                st.lists(inner, max_size=4)
                | st.dictionaries(
                    st.sampled_from(["version", "id", "type", "motion", "targets", "x"]), inner, max_size=5
                )
            ),
        ).map(lambda value: json.dumps(value).encode())
    )
    def test_noise_is_refused_or_a_message(self, payload: bytes) -> None:
        for kind in KINDS:
            with contextlib.suppress(WireError):
                codec.decode(payload, kind)
        with contextlib.suppress(WireError):
            codec.decode_reply(payload)
