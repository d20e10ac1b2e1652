"""Control of a robot: who has it, and until when. Wall nanoseconds of Redis."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Lease:
    """The control lease of one robot. The secret that proves it is never part of it."""

    id: str
    robot: str
    holder: str
    taken_ns: int
    expires_ns: int
    duration_s: float
