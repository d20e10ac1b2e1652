"""The way of joints that are jogged, from how they move now to their rest. Pure. SI units, by joint."""

import itertools
import math
from collections.abc import Iterator, Mapping
from typing import Any

from msgspec import Struct

from linked_fleet_agent.joint_ramp import Velocities, ramp_s, toward
from linked_fleet_state.driving import REACTION_S, fitting_share

_STEP_S = 0.02
_APART = 0.05
"""Sum of the ways of all joints between two positions of a way, in rad or m."""
_SLOWEST = 0.005
_PARALLEL = 0.01
_STILL = 1e-3
Way = tuple[Mapping[str, float], ...]


class JointDrive(Struct, frozen=True):
    """Velocities of joints for a time, after which they brake together."""

    velocities: dict[str, float]
    duration_s: float
    accelerations: dict[str, float]

    @property
    def standing(self) -> bool:
        return not any(self.velocities.values())

    @property
    def input(self) -> dict[str, Any]:
        """The velocities in the input of the action ``jogJoints``."""
        return {"velocities": {name: each for name, each in self.velocities.items() if each}}

    @property
    def standing_input(self) -> dict[str, Any]:
        """The input that brakes."""
        return {"velocities": {}}

    def slowed(self, share: float) -> "JointDrive":
        """Return the drive at a share of its speed, on the same line."""
        slower = {name: share * each for name, each in self.velocities.items()}
        return JointDrive(slower, self.duration_s, self.accelerations)

    @property
    def is_too_slow(self) -> bool:
        return max(map(abs, self.velocities.values()), default=0.0) < _SLOWEST

    def fitting_share(self, free: float) -> float:
        """Return the share of the speed at which only the share ``free`` of its way is needed."""
        return fitting_share(free, self.duration_s, ramp_s(self.velocities, {}, self.accelerations))

    def ways(self, now: Velocities, before: Velocities | None = None) -> tuple[Way, ...]:
        """Return the ways until the joints stand, each as how far they have gone.

        They move like ``now``. Until this request reaches them, at once or late, they go on like that, brake because
        the time of an earlier request is over, or go towards ``before``, the velocities of one that has not reached
        them either. Of ways on one line the longest is enough.
        """
        meanwhile = [now] if before is None else [now, before]
        late = [self._way(now, each, REACTION_S) for each in (*meanwhile, {})]
        if all(self._is_along(each) for each in meanwhile):
            return (max(late, key=lambda way: _length(way[-1])),)
        return (self._way(now, now, 0.0), *late)

    def end(self, now: Velocities) -> Mapping[str, float]:
        """Return how far the joints have gone when they stand."""
        return self._way(now, now, REACTION_S)[-1]

    def _is_along(self, velocities: Velocities) -> bool:
        """Return True if these velocities lead along the same line."""
        size, own = _length(velocities), _length(self.velocities)
        if size < _STILL or not own:
            return size < _STILL
        return all(
            abs(velocities.get(name, 0.0) / size - self.velocities.get(name, 0.0) / own) < _PARALLEL
            for name in self.accelerations
        )

    def _way(self, now: Velocities, meanwhile: Velocities, reaction_s: float) -> Way:
        return tuple(_sparse(self._steps(now, meanwhile, reaction_s)))

    def _steps(self, now: Velocities, meanwhile: Velocities, reaction_s: float) -> Iterator[Mapping[str, float]]:
        """Yield the ways after each step. The request holds for a step longer, since agents act once in a tick."""
        gone = dict.fromkeys(self.accelerations, 0.0)
        velocities = {name: now.get(name, 0.0) for name in gone}
        begins, brakes = round(reaction_s / _STEP_S), math.ceil((reaction_s + self.duration_s) / _STEP_S) + 1
        for step in itertools.count():
            if step >= brakes and not any(velocities.values()):
                return
            wanted = meanwhile if step < begins else self.velocities if step < brakes else {}
            before, velocities = velocities, toward(velocities, wanted, self.accelerations, _STEP_S)
            gone = {name: at + _STEP_S / 2 * (before[name] + velocities[name]) for name, at in gone.items()}
            yield gone


def _length(ways: Mapping[str, float]) -> float:
    return math.sqrt(sum(each * each for each in ways.values()))


def _sparse(ways: Iterator[Mapping[str, float]]) -> Iterator[Mapping[str, float]]:
    """Leave out what is near the one before, but not the last one."""
    kept: Mapping[str, float] = {}
    last: Mapping[str, float] | None = None
    for way in ways:
        last = way
        if sum(abs(each - kept.get(name, 0.0)) for name, each in way.items()) >= _APART:
            yield way
            kept, last = way, None
    if last is not None:
        yield last
