"""The latest frame of each robot, stored by the transport's thread and read by the event loop on demand.

On arrival of a frame that continues a run only the fields that could invalidate it are checked. So a robot that nobody
watches costs almost nothing, and malformed, late or foreign frames never replace a good one.
"""

import struct
from collections.abc import Callable, Container

from linked_fleet_agent.wire.codec import layout

_OFFSET = {field.name: field.offset for field in layout(1, False)}
_TIMES = struct.Struct("<Qqq")  # sequence, monotonic and wall time
_BEGIN = _OFFSET["sequence"]
"""Length of the prefix that all frames of one run and shape share: magic, version, flags, joints, incarnation."""


class Latest:
    """The latest frame of one run with one shape. One thread writes it, another reads; each attribute is replaced
    atomically.

    ``frame`` holds the payload and its gateway wall time of arrival (ns).
    """

    __slots__ = ("_begin", "_size", "frame", "robot", "scheduled", "sequence", "unreported")

    def __init__(self, robot: str, sequence: int, payload: bytes, now_ns: int) -> None:
        self.robot = robot
        self.sequence = sequence
        self.frame = (payload, now_ns)
        self.unreported = False
        """True if the watchers of the robot have not been told of the frame."""
        self.scheduled = False
        """True if the event loop is already scheduled to read it."""
        self._begin, self._size = payload[:_BEGIN], len(payload)

    def put(self, payload: bytes, now_ns: int) -> bool:
        """Store a frame that continues the run. Return False for any other, which needs a full check."""
        if len(payload) != self._size or not payload.startswith(self._begin):
            return False
        sequence, monotonic_ns, wall_ns = _TIMES.unpack_from(payload, _BEGIN)
        if sequence <= self.sequence or monotonic_ns < 0 or wall_ns < 0:
            return False
        self.sequence = sequence
        self.frame = (payload, now_ns)
        self.unreported = True
        return True


class Frames:
    """The latest frame of each robot. ``key_of`` maps a robot's name to the key of its frames.

    ``taken`` counts stored frames. Frames are reported at once for robots in ``watched``, or for all robots
    while ``has_listeners``.
    """

    def __init__(self, key_of: Callable[[str], str] = str) -> None:
        self.taken = 0
        self.watched: Container[str | None] = frozenset()
        self.has_listeners = False
        self._key_of = key_of
        self._latest: dict[str, Latest] = {}

    def open(self, latest: Latest) -> None:
        """Store frames that continue this run from now on."""
        self._latest[self._key_of(latest.robot)] = latest

    def close(self, robot: str) -> None:
        self._latest.pop(self._key_of(robot), None)

    def all(self) -> list[Latest]:
        """Return the latest frames of all robots. Only the event loop, which opens and closes them, may call this."""
        return list(self._latest.values())

    def put(self, key: str, payload: bytes, now_ns: int) -> Latest | None:
        """Store a frame; return None if it is not known to be valid. Called by one thread at a time."""
        latest = self._latest.get(key)
        if latest is None or not latest.put(payload, now_ns):
            return None
        self.taken += 1
        return latest

    def urgent(self, latest: Latest) -> bool:
        """Return True if the event loop must be told and is not scheduled yet."""
        return not latest.scheduled and (self.has_listeners or latest.robot in self.watched)

    def unreported(self, robot: str) -> bool:
        """Return True if a frame has arrived that was not reported, because nobody watched the robot then."""
        latest = self._latest.get(self._key_of(robot))
        return latest is not None and latest.unreported
