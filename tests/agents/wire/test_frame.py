"""State frames: round trips to the bit, the layout that describes them, and every malformed one refused."""

import contextlib
import math
import struct

import numpy
import pytest
from hypothesis import given
from hypothesis import strategies as st

from linked_fleet_agent.wire import codec
from linked_fleet_agent.wire.codec import MAX_JOINTS, VersionError, WireError
from linked_fleet_agent.wire.messages import WIRE_VERSION, Base, State

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


@given(states())
def test_a_frame_comes_back_to_the_bit(state: State) -> None:
    payload = codec.encode_state(state)
    again = codec.decode_state(payload)
    assert codec.encode_state(again) == payload
    assert (again.incarnation, again.sequence) == (state.incarnation, state.sequence)
    assert (again.monotonic_ns, again.wall_ns) == (state.monotonic_ns, state.wall_ns)
    assert repr(again.base) == repr(state.base)  # repr: NaN differs from itself


@given(states())
def test_numpy_decodes_a_frame_by_its_layout(state: State) -> None:
    """Desideratum D5: the layout suffices to read the binary state, without this code."""
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


def test_an_unknown_value_stays_unknown() -> None:
    assert all(math.isnan(value) for value in codec.decode_state(frame(value=math.nan)).efforts)


@pytest.mark.parametrize("version", [0, WIRE_VERSION + 1, 65_535])
def test_another_version_is_refused_by_its_number(version: int) -> None:
    payload = bytearray(frame())
    struct.pack_into("<H", payload, 2, version)
    with pytest.raises(
        VersionError, match=f"version {version} is not supported; these messages have version {WIRE_VERSION}"
    ):
        codec.decode_state(bytes(payload))


@pytest.mark.parametrize("floating", [False, True])
def test_every_truncation_is_refused(floating: bool) -> None:
    payload = frame(floating=floating)
    for length in range(len(payload)):
        with pytest.raises(WireError):
            codec.decode_state(payload[:length])


@pytest.mark.parametrize("value", [math.inf, -math.inf])
@pytest.mark.parametrize("floating", [False, True])
def test_an_infinite_value_is_refused(value: float, floating: bool) -> None:
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
def test_a_header_that_is_not_true_is_refused(offset: int, field: bytes, text: str) -> None:
    payload = bytearray(frame())
    payload[offset : offset + 2] = field
    with pytest.raises(WireError, match=text):
        codec.decode_state(bytes(payload))


def test_more_than_the_frame_is_refused() -> None:
    with pytest.raises(WireError, match="announces"):
        codec.decode_state(frame() + b"\x00")


def test_the_largest_frame_is_taken_and_a_larger_never_made() -> None:
    assert len(codec.decode_state(frame(MAX_JOINTS)).positions) == MAX_JOINTS
    with pytest.raises(WireError, match="at most 1024"):
        frame(MAX_JOINTS + 1)


@given(st.binary(max_size=200) | st.binary(max_size=200).map(lambda rest: b"LF\x01\x00" + rest))
def test_noise_is_refused_or_a_frame(payload: bytes) -> None:
    with contextlib.suppress(WireError):
        codec.decode_state(payload)


@given(st.data())
def test_a_damaged_frame_is_refused_or_a_frame(data: st.DataObject) -> None:
    payload = bytearray(frame(floating=data.draw(st.booleans())))
    for index in data.draw(st.lists(st.integers(0, len(payload) - 1), min_size=1, max_size=4)):
        payload[index] = data.draw(st.integers(0, 255))
    with contextlib.suppress(WireError):
        codec.decode_state(bytes(payload))
