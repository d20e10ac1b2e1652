"""Chooses the frames of a robot that are worth a place on disk. Pure; times are those of the agent, in nanoseconds.

Of a robot that moves, at most ``rate_hz`` frames a second are kept; of one that rests, one in ``STILL_NS``. The last
frame before a change is kept too, so that a line between two kept frames is no motion that never was. Where nothing was
heard, the record has a frame of which all values are unknown (``gap_after``): it ends what is known.
"""

import math
import struct
from collections.abc import Sequence
from itertools import zip_longest

from linked_fleet_agent.wire.codec import layout
from linked_fleet_gateway.extensions.history.track import LATEST_NS, wall_ns

STILL_NS = 10 * 10**9
"""The longest time between two kept frames of a robot that is heard."""
GAP_NS = 2 * 10**9
"""A robot that has sent nothing for longer was not heard."""
AHEAD_NS = 60 * 10**9
"""Largest lead of a stamp over the clock here; what is stamped later is not recorded."""
_VALUES_AT = next(field.offset for field in layout(1, False) if field.name == "positions")
_WALL_AT = next(field.offset for field in layout(1, False) if field.name == "wall_ns")
_WALL = struct.Struct("<q")
_UNKNOWN = struct.pack("<d", math.nan)
_TOLERANCE = 0.95
"""The share of the shortest time between two frames that is enough, since frames come with some jitter."""


def gap_after(frame: bytes) -> bytes:
    """Return the frame that says that nothing is known from just after ``frame`` on."""
    said = bytearray(frame[:_VALUES_AT])
    _WALL.pack_into(said, _WALL_AT, min(wall_ns(frame) + 1, LATEST_NS))
    return bytes(said) + _UNKNOWN * ((len(frame) - _VALUES_AT) // len(_UNKNOWN))


def is_gap(frame: bytes) -> bool:
    """Return True for the frame of a gap: none of its values is known."""
    return len(frame) > _VALUES_AT and frame[_VALUES_AT:] == _UNKNOWN * ((len(frame) - _VALUES_AT) // len(_UNKNOWN))


def spaced(frames: Sequence[bytes], every_ns: int, with_last: bool = True) -> tuple[bytes, ...]:
    """Return the frames that are at least ``every_ns`` after the one that was kept before, and the last one if asked.

    A gap stays, with the frames before and after it, so that nothing is known for longer or shorter than it was.
    """
    kept = list[bytes]()
    for each, following in zip_longest(frames, frames[1:]):
        if following is None and with_last:
            kept.append(each)
            continue
        late = not kept or wall_ns(each) - wall_ns(kept[-1]) >= every_ns
        if late or is_gap(each) or is_gap(following or b"") or is_gap(kept[-1]):
            kept.append(each)
    return tuple(kept)


class Thinning:
    """The choice for one robot, frame by frame in the order of their arrival."""

    def __init__(self, rate_hz: float) -> None:
        self._period_ns = int(_TOLERANCE * 1e9 / rate_hz)
        self._heard: bytes | None = None
        self._kept: bytes | None = None

    def take(self, frame: bytes) -> list[bytes]:
        """Return what is to be kept now that a frame has come."""
        found = list[bytes]()
        stamp_ns, heard = wall_ns(frame), self._heard
        if heard is not None and (stamp_ns - wall_ns(heard) > GAP_NS or stamp_ns <= wall_ns(heard)):
            found += self.end() if stamp_ns > wall_ns(heard) else []
            self._heard = self._kept = None  # also if the clock of the agent was set back
        found += self._choose(frame, stamp_ns)
        self._heard = frame
        return found

    def end(self) -> list[bytes]:
        """Return what is to be kept when the robot is heard no longer: its last frame, and a gap."""
        heard, kept = self._heard, self._kept
        self._heard = self._kept = None
        if heard is None:
            return []
        return [*([] if heard is kept else [heard]), gap_after(heard)]

    def _choose(self, frame: bytes, stamp_ns: int) -> list[bytes]:
        kept, heard = self._kept, self._heard
        if kept is None:
            self._kept = frame
            return [frame]
        age_ns = stamp_ns - wall_ns(kept)
        changed = frame[_VALUES_AT:] != kept[_VALUES_AT:]
        if age_ns < self._period_ns or not (changed or age_ns >= STILL_NS):
            return []
        self._kept = frame
        rested = heard is not None and heard is not kept and heard[_VALUES_AT:] == kept[_VALUES_AT:]
        return [heard, frame] if changed and rested and heard is not None else [frame]
