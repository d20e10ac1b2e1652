"""The control lease of a robot. Times are Redis wall time in nanoseconds."""

from dataclasses import dataclass, field


@dataclass(frozen=True)
class Lease:
    """The control lease of one robot, without the secret that proves it.

    ``left_s`` is the remaining time when Redis was asked, independent of the gateway's clock.
    """

    id: str
    robot: str
    holder: str
    taken_ns: int
    expires_ns: int
    duration_s: float
    left_s: float = field(default=0.0, compare=False)
