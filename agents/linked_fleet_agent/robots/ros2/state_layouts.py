"""Joint states of one topic, read by the layouts of earlier ones. Pure.

Publishers repeat the frame and the names of their joints. A message that agrees with an earlier one in these bytes, its
length and the counts of its rows has its numbers at the same places, which one ``struct`` reads.
"""

import struct
from collections import deque
from collections.abc import Callable
from operator import itemgetter
from typing import Any, NamedTuple

from linked_fleet_agent.robots.ros2 import cdr
from linked_fleet_agent.robots.ros2.cdr import JointState

_BODY, _STAMP = 4, 8
"""Bytes before the fields, which name the encoding, and bytes of the stamp, which is the first field."""
_MOST = 16
"""Layouts that are remembered, one of each publisher."""


class JointStateReader:
    """Reads joint states. Any without a known layout is read as messages of all types are, and tells its own."""

    name = cdr.JOINT_STATE

    def __init__(self) -> None:
        self._layouts = deque[_Layout](maxlen=_MOST)

    def read(self, payload: bytes, most_bytes: int = cdr.MAX_STATE_BYTES) -> JointState:
        """Return the message. Raises CdrError."""
        for layout in self._layouts:
            if (said := layout.read(payload)) is not None:
                return said
        said = cdr.read_joint_state(payload, most_bytes)
        self._layouts.append(_layout_of(payload, said.names))
        return said


class _Layout(NamedTuple):
    """The places of the numbers.

    ``numbers`` reads stamp and rows, each after its count. ``counts`` picks the counts, which are ``expected``, and
    ``rows`` the rows.
    """

    length: int
    encoding: bytes
    named: bytes
    names: tuple[str, ...]
    numbers: struct.Struct
    counts: Callable[[tuple[Any, ...]], tuple[int, ...]]
    expected: tuple[int, ...]
    rows: tuple[slice, ...]

    def read(self, payload: bytes) -> JointState | None:
        """Return the message; None if its layout is another one."""
        if len(payload) != self.length or payload[:2] != self.encoding:
            return None
        if not payload.startswith(self.named, _BODY + _STAMP):
            return None
        said = self.numbers.unpack_from(payload, _BODY)
        if self.counts(said) != self.expected:
            return None
        positions, velocities, efforts = self.rows
        rows = said[positions], said[velocities], said[efforts]
        return JointState(said[0] * 1_000_000_000 + said[1], self.names, *cdr.known(rows, len(self.names)))


def _layout_of(payload: bytes, names: tuple[str, ...]) -> _Layout:
    """Return the layout of a message that could be read."""
    body, order = payload[_BODY:], "<" if payload[1] else ">"
    word = struct.Struct(order + "I")

    def count_at(at: int) -> int:
        return int(word.unpack_from(body, at)[0])

    at = _STAMP + 4 + count_at(_STAMP)
    at = _aligned(at) + 4
    for _ in names:
        at = _aligned(at) + 4 + count_at(_aligned(at))
    form, rows, item = f"{order}iI{at - _STAMP}x", list[slice](), 2
    named = body[_STAMP:at]
    for _ in range(3):
        begin, end = _aligned(at), _aligned(at) + 4
        count = count_at(begin)
        first = _aligned(end, 8) if count else end
        form += f"{begin - at}xI{first - end}x{count}d"
        at = first + 8 * count
        rows.append(slice(item + 1, item + 1 + count))
        item += 1 + count
    counts, expected = itemgetter(*(row.start - 1 for row in rows)), tuple(row.stop - row.start for row in rows)
    return _Layout(len(payload), payload[:2], named, names, struct.Struct(form), counts, expected, tuple(rows))


def _aligned(at: int, size: int = 4) -> int:
    return (at + size - 1) & -size
