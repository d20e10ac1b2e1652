"""Reads the frames of a recording again, as the table that histories have too."""

import io
import math
import struct
from typing import TYPE_CHECKING

from linked_fleet_agent.urdf.document import UrdfError
from linked_fleet_base.lazy_imports import LazyModule
from linked_fleet_gateway.extensions.history.files import table
from linked_fleet_gateway.extensions.history.track import Joints, Numbers, all_columns
from linked_fleet_rdf.serialise import NoContentYet
from linked_fleet_state.model import RobotModel

if TYPE_CHECKING:
    from mcap import reader as mcap
else:
    mcap = LazyModule("mcap.reader")

_ENCAPSULATION = 4
_UNKNOWN_BASE: Numbers = (math.nan,) * 13


def table_of(robot: str, content: bytes) -> bytes:
    """Return the joint states of an MCAP file of this gateway as CSV, with the pose of a floating base.

    Velocities of the base are unknown, since the file has none. Raises NoContentYet.
    """
    try:
        joints, rows = _read(content)
        return table(all_columns(robot, joints), rows)
    except (UrdfError, ValueError, KeyError, IndexError, struct.error) as error:
        raise NoContentYet(f"the recording cannot be read: {error}") from error
    except Exception as error:
        raise NoContentYet(f"the recording is damaged: {type(error).__name__}") from error


def _read(content: bytes) -> tuple[Joints, list[tuple[int, Numbers]]]:
    urdf, names, floating = "", tuple[str, ...](), False
    rows, bases = list[tuple[int, Numbers]](), dict[int, Numbers]()
    topics = ["/robot_description", "/joint_states", "/tf"]
    for _, channel, message in mcap.make_reader(io.BytesIO(content)).iter_messages(topics):
        said = _Cdr(message.data)
        if channel.topic == "/robot_description":
            urdf = said.string()
        elif channel.topic == "/tf":
            floating = True
            bases[message.log_time] = said.transform()
        else:
            names, numbers = said.joint_state()
            rows.append((message.log_time, numbers))
    if floating:
        rows = [(at, (*bases.get(at, _UNKNOWN_BASE), *numbers)) for at, numbers in rows]
    return Joints(RobotModel.for_urdf(urdf), names, floating), rows


class _Cdr:
    """Reads a message in plain OMG CDR, little-endian, from its beginning."""

    def __init__(self, data: bytes) -> None:
        self._data, self._at = data[_ENCAPSULATION:], 0

    def _numbers(self, kind: str, size: int, count: int) -> tuple[float, ...]:
        self._at += -self._at % size
        found = struct.unpack_from(f"<{count}{kind}", self._data, self._at)
        self._at += size * count
        return found

    def count(self) -> int:
        return int(self._numbers("I", 4, 1)[0])

    def string(self) -> str:
        size = self.count()
        found = self._data[self._at : self._at + size - 1].decode()
        self._at += size
        return found

    def doubles(self, count: int) -> tuple[float, ...]:
        return self._numbers("d", 8, count) if count else ()

    def header(self) -> None:
        self.count()
        self.count()
        self.string()

    def joint_state(self) -> tuple[tuple[str, ...], Numbers]:
        self.header()
        names = tuple(self.string() for _ in range(self.count()))
        return names, tuple(value for _ in range(3) for value in self.doubles(self.count()))

    def transform(self) -> Numbers:
        """Return the pose of a base, with an unknown velocity."""
        self.count()
        self.header()
        self.string()
        return (*self.doubles(7), *_UNKNOWN_BASE[7:])
