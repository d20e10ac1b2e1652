"""Control of a robot: who has it, and until when. Wall nanoseconds of Redis."""

from dataclasses import dataclass, field


@dataclass(frozen=True)
class Lease:
    """The control lease of one robot. The secret that proves it is never part of it.

    ``left_s`` is what was left of it when Redis was asked, whatever the clock of who asks says.
    """

    id: str
    robot: str
    holder: str
    taken_ns: int
    expires_ns: int
    duration_s: float
    left_s: float = field(default=0.0, compare=False)
