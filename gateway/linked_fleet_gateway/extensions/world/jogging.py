"""Joints that are jogged: how fast they are, and where they will be."""

import math
import time
from collections.abc import Callable, Iterator, Mapping

from linked_fleet_agent.joint_ramp import ramp_s
from linked_fleet_gateway.extensions.world.messages import PathSegment, Positions
from linked_fleet_gateway.extensions.world.other_motions import thinned
from linked_fleet_state.jogging import JointDrive
from linked_fleet_state.robot import Robot

_MARGIN_S = 0.5
_NO_WAY = 1e-6


def velocities_of(robot: Robot) -> Positions:
    """Return the measured velocities of the joints, as far as they are known."""
    if robot.frame is None or robot.description is None:
        return {}
    measured = zip(robot.description.joints, robot.frame.velocities, strict=True)
    return {name: each for name, each in measured if math.isfinite(each)}


class Jogs:
    """The jogging that this gateway has let begin."""

    def __init__(self, now_s: Callable[[], float] = time.monotonic) -> None:
        self._now_s = now_s
        self._begun = dict[str, tuple[JointDrive, float]]()

    def begin(self, robot: Robot, drive: JointDrive) -> None:
        lasts_s = drive.duration_s + ramp_s(drive.velocities, {}, drive.accelerations) + _MARGIN_S
        self._begun[robot.name] = drive, self._now_s() + lasts_s

    def latest(self, robot: Robot) -> JointDrive | None:
        """Return the latest of these that may still move joints."""
        drive, until_s = self._begun.get(robot.name, (None, 0.0))
        return drive if self._now_s() < until_s else None

    def ends(self, robot: Robot) -> Positions:
        """Return where the joints may be when they stand; nothing if they are not jogged."""
        drive = self.latest(robot)
        if drive is None:
            self._begun.pop(robot.name, None)
            return {}
        return _ahead(robot.positions, drive.end(velocities_of(robot)))

    def along(self, robot: Robot) -> Iterator[Positions]:
        """Yield where the joints may be on their ways there: the request reaches them at once, or late."""
        if (drive := self.latest(robot)) is not None:
            for way in drive.ways(velocities_of(robot)):
                yield from (_ahead(robot.positions, gone) for gone in thinned(way))

    def legs(self, robot: Robot, drive: JointDrive) -> Iterator[tuple[PathSegment, ...]]:
        """Yield the ways of joints that are about to be jogged like this."""
        before = self.latest(robot)
        for way in drive.ways(velocities_of(robot), None if before is None else before.velocities):
            yield tuple(PathSegment(_ahead(robot.positions, gone)) for gone in way)


def _ahead(positions: Mapping[str, float], gone: Mapping[str, float]) -> Positions:
    """Return where joints are after ways that are more than rounding."""
    moved = {name: way for name, way in gone.items() if abs(way) > _NO_WAY}
    return {name: at + way for name, way in moved.items() if math.isfinite(at := positions.get(name, math.nan))}
