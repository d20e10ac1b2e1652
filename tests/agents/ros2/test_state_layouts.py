"""Joint states read by layouts of earlier ones, against those that are read alone."""

import math
from contextlib import suppress
from random import Random

import pytest

from linked_fleet_agent.robots.ros2 import cdr
from linked_fleet_agent.robots.ros2.cdr import CdrError, JointState
from linked_fleet_agent.robots.ros2.state_layouts import JointStateReader
from ros2_robot import joint_state


def check(reader: JointStateReader, payload: bytes) -> JointState | None:
    """Check that the reader reads, or refuses, a message as it is read alone."""
    try:
        alone = cdr.read_joint_state(payload)
    except CdrError:
        with pytest.raises(CdrError):
            reader.read(payload)
        return None
    said = reader.read(payload)
    assert repr(said) == repr(alone)
    return said


@pytest.mark.parametrize("little_endian", [True, False])
@pytest.mark.parametrize("count", [0, 1, 2, 7])
def test_a_message_is_read_by_the_layout_of_the_one_before(count: int, little_endian: bool) -> None:
    reader, names = JointStateReader(), [f"joint_{number}" for number in range(count)]
    for number in range(3):
        rows = [[number + 0.1 * row] * count for row in range(3)]
        said = check(reader, joint_state(names, *rows, stamp_ns=number, little_endian=little_endian))
        assert said is not None and said.positions == (float(number),) * count and said.stamp_ns == number
    assert check(reader, joint_state(names, [2.0] * count, stamp_ns=5, little_endian=not little_endian)) is not None


def test_names_that_change_and_rows_that_come_and_go_are_told_apart() -> None:
    """All these messages have the same length."""
    reader = JointStateReader()
    for _ in range(2):
        for names in (["pan", "lift"], ["lift", "pan"], ["pan", "lifu"]):
            for rows in ([[1, 2], [], []], [[], [1, 2], []], [[], [], [1, 2]]):
                said = check(reader, joint_state(names, *rows))
                assert said is not None and said.names == tuple(names)


def test_values_that_are_not_finite_are_unknown() -> None:
    reader = JointStateReader()
    for values in (
        [1.0, 2.0],
        [math.inf, 2.0],
        [-math.inf, math.inf],
        [math.nan, math.inf],
        [math.nan, 1.0],
        [1e308] * 2,
    ):
        said = check(reader, joint_state(["a", "b"], values, values))
        assert said is not None and not any(map(math.isinf, (*said.positions, *said.velocities)))


def test_more_publishers_than_layouts_are_read_too() -> None:
    reader = JointStateReader()
    for _ in range(2):
        for number in range(100):
            check(reader, joint_state([f"joint_{number}"], [number]))


def test_damaged_messages_are_read_or_refused_as_alone() -> None:
    random, reader = Random(41), JointStateReader()
    good = [
        joint_state(["a", "bcd", "é"], *([0.5] * 3 if has else [] for has in rows)) for rows in ((1, 1, 0), (1, 0, 1))
    ]
    for _ in range(3000):
        payload = bytearray(random.choice(good))
        for _ in range(random.choice((0, 0, 1, 2))):
            payload[random.randrange(len(payload))] = random.choice((0, 1, 2, 3, 4, 8, 255))
        payload = payload[: random.choice((len(payload), random.randrange(len(payload)), len(payload)))]
        with suppress(CdrError):
            check(reader, bytes(payload) + bytes(random.choice((0, 0, 0, 2, 5))))
