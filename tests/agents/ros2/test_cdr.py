"""Bytes of ROS 2 messages, and hashes of their types."""

import math
from contextlib import suppress

import pytest
from hypothesis import given
from hypothesis import strategies as st

from linked_fleet_agent.robots.ros2 import cdr
from linked_fleet_agent.robots.ros2.cdr import CdrError, JointState
from ros2_robot import joint_state, text

# A JointState by hand, from the rules of plain CDR (OMG DDS-XTypes 1.3, 7.4.3.2; version 1): after four bytes of
# encapsulation everything is aligned to its own size, and a string has its length with the NUL that ends it.
BY_HAND = bytes.fromhex(
    "00010000"  # CDR, little-endian, no options
    "0a000000 14000000"  # stamp: 10 s and 20 ns
    "05000000 6261736500 000000"  # frame "base", padded to 4
    "02000000"  # two names
    "04000000 70616e00"  # "pan"
    "03000000 757000 00"  # "up", padded to 4
    "02000000"  # two positions, at 40
    "00000000"  # doubles are aligned to 8
    "000000000000f03f 000000000000e0bf"  # 1.0, -0.5
    "00000000"  # no velocities
    "02000000"  # two efforts, at 68
    "0000000000000440 000000000000f07f"  # 2.5, infinite
)


def test_the_hashes_are_the_published_ones() -> None:
    """String: rmw_zenoh, docs/design.md. The others: as ``ros2 topic info --verbose`` prints them for ros2_control."""
    assert [cdr.type_hash(name) for name in (cdr.STRING, cdr.JOINT_STATE, cdr.JOINT_TRAJECTORY)] == [
        "RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18",
        "RIHS01_a13ee3a330e346c9d87b5aa18d24e11690752bd33a0350f11c5882bc9179260e",
        "RIHS01_179b33eba59d676f6d967ac71fe35e7ca2f64b2f3928f4a018cec115e213796e",
    ]


def test_a_message_made_by_hand_is_read() -> None:
    said = cdr.read_joint_state(BY_HAND)
    assert (said.stamp_ns, said.names, said.positions) == (10_000_000_020, ("pan", "up"), (1.0, -0.5))
    assert all(math.isnan(velocity) for velocity in said.velocities) and len(said.velocities) == 2
    assert said.efforts[0] == 2.5 and math.isnan(said.efforts[1])


def test_big_endian_is_as_good() -> None:
    for little_endian in (True, False):
        said = cdr.read_joint_state(joint_state(["a", "bcd"], [0.1, 0.2], [], [1, 2], 5, little_endian))
        assert (said.stamp_ns, said.names, said.positions, said.efforts) == (5, ("a", "bcd"), (0.1, 0.2), (1.0, 2.0))


def test_a_trajectory_is_written_as_ros_writes_it() -> None:
    assert cdr.write_trajectory(["pan", "up"], [1.0, -0.5], 1.25) == bytes.fromhex(
        "00010000"
        "00000000 00000000 01000000 00000000"  # no stamp, which is now; no frame, padded
        "02000000 04000000 70616e00 03000000 75700000"  # joint names
        "01000000"  # one point
        "02000000 00000000 000000000000f03f 000000000000e0bf"  # positions, aligned to 8
        "00000000 00000000 00000000"  # no velocities, accelerations, efforts
        "01000000 80b2e60e"  # 1 s and 250,000,000 ns
    )


@pytest.mark.parametrize(
    "payload",
    [
        b"",
        b"\x00\x01",
        b"\x00\x03" + joint_state([])[2:],  # a parameter list
        b"\x00\x07" + joint_state([])[2:],  # XCDR2
        joint_state(["a"], [1.0])[:-9],
        joint_state(["a"], [1.0]) + bytes(9),
        joint_state([])[:12] + b"\xff\xff\xff\xff" + joint_state([])[16:],
        joint_state([])[:16] + b"\xff\xff\xff\x7f" * 8,
        joint_state(["\x00" * 8]).replace(b"\x00" * 8, b"\xff" * 8),
        joint_state(["a", "a"], [1, 2]),
        joint_state(["a", "b"], [1]),
        joint_state([str(number) for number in range(1025)]),
        bytes(cdr.MAX_STATE_BYTES + 1),
    ],
)
def test_invalid_joint_states_are_refused(payload: bytes) -> None:
    with pytest.raises(CdrError):
        cdr.read_joint_state(payload)


@given(st.binary(max_size=200), st.booleans())
def test_any_bytes_are_read_or_refused(noise: bytes, little_endian: bool) -> None:
    for read in (cdr.read_joint_state, cdr.read_string):
        with suppress(CdrError):
            assert isinstance(read(bytes([0, little_endian, 0, 0]) + noise), JointState | str)


def test_a_text_is_read() -> None:
    assert cdr.read_string(text("<robot/> äöü")) == "<robot/> äöü"
    with pytest.raises(CdrError):
        cdr.read_string(text("x" * cdr.MAX_TEXT_BYTES))
