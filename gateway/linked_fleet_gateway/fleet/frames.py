"""The latest frame of each robot, put by the transport's thread and looked at by the event loop when somebody asks.

Of a frame that continues a run nothing is looked at when it comes but what would have it refused: so a robot that
nobody watches costs next to nothing, and what is malformed, late or of another run never displaces a good frame.
"""

import struct
from collections import Counter
from collections.abc import Callable, Container

from linked_fleet_agent.wire.codec import layout

_OFFSET = {field.name: field.offset for field in layout(1, False)}
_TIMES = struct.Struct("<Qqq")  # sequence, monotonic and wall time
_BEGIN = _OFFSET["sequence"]
"""Bytes that are the same in all frames of one run and shape: magic, version, flags, joints, incarnation."""


class Latest:
    """The frames of one run with one shape. Written by one thread, read by another: each attribute is always whole.

    ``frame``: payload, and gateway wall time (ns) at which it came.
    """

    __slots__ = ("_begin", "_size", "frame", "robot", "rung", "sequence", "untold")

    def __init__(self, robot: str, sequence: int, payload: bytes, now_ns: int) -> None:
        self.robot = robot
        self.sequence = sequence
        self.frame = (payload, now_ns)
        self.untold = False
        """True if a frame came that who watches the robot was not told of."""
        self.rung = False
        """True if the event loop is already on its way to look at it."""
        self._begin, self._size = payload[:_BEGIN], len(payload)

    def put(self, payload: bytes, now_ns: int) -> bool:
        """Take a frame that continues the run; any other is refused, and somebody has to look at it more closely."""
        if len(payload) != self._size or not payload.startswith(self._begin):
            return False
        sequence, monotonic_ns, wall_ns = _TIMES.unpack_from(payload, _BEGIN)
        if sequence <= self.sequence or monotonic_ns < 0 or wall_ns < 0:
            return False
        self.sequence = sequence
        self.frame = (payload, now_ns)
        self.untold = True
        return True


class Frames:
    """The latest frame of each robot. ``key_of`` makes a robot's name the key under which its frames come.

    ``taken`` counts frames put here. Whose frames are to be told at once: those in ``watched`` and in ``awaited``, and
    all while ``heeded``.
    """

    def __init__(self, key_of: Callable[[str], str] = str) -> None:
        self.taken = 0
        self.watched: Container[str | None] = frozenset()
        self.awaited: Counter[str] = Counter()
        self.heeded = False
        self._key_of = key_of
        self._latest: dict[str, Latest] = {}

    def open(self, latest: Latest) -> None:
        """From now on frames that continue this run are put here."""
        self._latest[self._key_of(latest.robot)] = latest

    def close(self, robot: str) -> None:
        self._latest.pop(self._key_of(robot), None)

    def all(self) -> list[Latest]:
        """The frames of each robot that has sent any, for the event loop, which alone opens and closes them."""
        return list(self._latest.values())

    def put(self, key: str, payload: bytes, now_ns: int) -> Latest | None:
        """None for a frame that is not known to be good. Called by one thread at a time."""
        latest = self._latest.get(key)
        if latest is None or not latest.put(payload, now_ns):
            return None
        self.taken += 1
        return latest

    def urgent(self, latest: Latest) -> bool:
        """Return True if somebody has to be told, who is not on the way to look already."""
        return not latest.rung and (self.heeded or latest.robot in self.watched or latest.robot in self.awaited)

    def untold(self, robot: str) -> bool:
        """Return True if a frame came of which nobody was told, because nobody watched the robot then."""
        latest = self._latest.get(self._key_of(robot))
        return latest is not None and latest.untold
