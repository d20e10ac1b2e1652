"""The setpoint of one joint on its trajectory, and whether the joint follows it. Pure: measurements are passed in."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

from linked_fleet_agent.plan import Start
from linked_fleet_agent.robot import JointFacts, Limits
from linked_fleet_agent.trajectory import Trajectory, brake, hold, reach
from linked_fleet_agent.urdf.cruise import RAMP_S, cruise_of
from linked_fleet_agent.urdf.facts import TOLERANCE_M, TOLERANCE_RAD

# A stopped joint must be measured in one place for this long.
STANDSTILL_S = 0.2
# A joint with a coarser sensor may stand this far from its target: by the smallest change that the sensor shows, if its
# driver declares neither tolerance nor resolution.
MAX_RESOLUTION_RAD, MAX_RESOLUTION_M = 0.01, 2e-3
# The setpoint waits for a joint that lags behind it: it slows down from half of this lag on, and stops at this lag.
MAX_LAG_RAD, MAX_LAG_M = 0.4, 0.1
# A joint is stuck if the setpoint waits and it stands for this long. One that is twice this lag away is carried away.
STUCK_S = 0.5
# After the end of its trajectory a joint may stand off its target, and move, for this long.
SETTLE_S, MAX_SETTLE_S = 2.0, 30.0
# A smaller change of a measured position is rounding.
_NO_CHANGE = 1e-9


@dataclass(frozen=True)
class Measurements:
    """Positions and efforts by joint; NaN is unknown.

    ``standing_s`` is the time for which a joint has been measured in one place. ``faults`` has a sentence for each
    joint whose sensor cannot be believed.
    """

    positions: Mapping[str, float]
    efforts: Mapping[str, float] = field(default_factory=dict)
    standing_s: Mapping[str, float] = field(default_factory=dict)
    faults: Mapping[str, str] = field(default_factory=dict)


class Axis:
    """The trajectory of one joint, and the position and velocity of its setpoint (rad, rad/s or m, m/s)."""

    def __init__(self, joint: JointFacts, position: float) -> None:
        self.joint = joint
        self.position, self.velocity = position, 0.0
        self._limits = joint.limits
        self.trajectory, self._time_s = hold(self.position), 0.0
        self.at_rest = True
        self.waiting_s = 0.0
        """Time for which the setpoint has waited for the joint, which stands."""
        self._tolerance, self._coarsest = (
            (TOLERANCE_M, MAX_RESOLUTION_M) if joint.linear else (TOLERANCE_RAD, MAX_RESOLUTION_RAD)
        )
        self._measured, self._resolution = math.nan, math.inf
        self.max_lag = MAX_LAG_M if joint.linear else MAX_LAG_RAD

    @property
    def start(self) -> Start:
        return Start(self.joint, self.position, self.velocity)

    @property
    def braking(self) -> Trajectory:
        """The trajectory that brakes the joint to rest from its present setpoint."""
        return brake(self.position, self.velocity, cruise_of(self.joint) / RAMP_S, self.joint.limits)

    def follow(self, trajectory: Trajectory, limits: Limits | None = None) -> None:
        """Follow ``trajectory`` from now on, within ``limits`` (those of the joint by default).

        Its last setpoint is applied even if it is the only one.
        """
        self._limits = limits or self.joint.limits
        self.position, self.velocity = trajectory.at(0.0)
        self.trajectory, self._time_s, self.at_rest = trajectory, 0.0, False
        self.waiting_s = 0.0

    def pace(self, measured: Measurements, dt_s: float) -> float:
        """Return the share of its speed at which the setpoint moves on: less if the joint lags behind, 0 at worst."""
        position, lag = measured.positions[self.joint.name], self.lag(measured)
        if (change := abs(self.joint.difference(position, self._measured))) > _NO_CHANGE:
            self._resolution = min(self._resolution, change)
        self._measured = position
        if not lag > self.max_lag / 2.0:
            self.waiting_s = 0.0
            return 1.0
        stands = measured.standing_s.get(self.joint.name, 0.0) >= STANDSTILL_S
        self.waiting_s = self.waiting_s + dt_s if stands else 0.0
        return max(0.0, 2.0 - 2.0 * lag / self.max_lag)

    def step(self, dt_s: float, pace: float = 1.0) -> float:
        """Advance by ``dt_s`` at a ``pace`` from 0 to 1, and return the setpoint."""
        self._time_s += dt_s * pace
        position, velocity = self.trajectory.at(self._time_s)
        self.velocity = velocity * pace
        if (within := self._limits.clamp(position)) != position:  # no further out than the joint is already
            within = self._limits.including(self.position).clamp(position)
        self.position = within
        self.at_rest = self._time_s >= self.trajectory.duration_s
        return self.position

    def finish(self) -> None:
        """Take the trajectory as ended, because what follows it says so."""
        self._time_s = self.trajectory.duration_s
        self.position, self.velocity = self.trajectory.end, 0.0
        self.at_rest = True

    def return_to(self, measured: float) -> None:
        """Move the setpoint back to the measured position, as slowly as any motion."""
        cruise = cruise_of(self.joint)
        target = self.position + self.joint.difference(measured, self.position)
        limits = self.joint.limits.including(target).including(self.position)
        self.follow(reach(self.position, self.velocity, target, cruise, cruise / RAMP_S, limits), limits)

    def arrived(self, measured: Measurements) -> bool:
        """Return True if the joint is at the end of its trajectory, or stands as near as it is known to come."""
        off = abs(self.joint.difference(self.trajectory.end, measured.positions[self.joint.name]))
        if not self.at_rest:
            return False
        declared = self.joint.arrival_tolerance
        if declared is None and off <= self._tolerance:
            return True
        seen = self._resolution if self._resolution <= self._coarsest else 0.0
        return off <= (seen if declared is None else declared) and self.stands(measured)

    def gives_up(self, measured: Measurements, resting_s: float) -> bool:
        """Return True if the joint is stuck, or does not arrive ``resting_s`` after the end of its trajectory."""
        if self.waiting_s >= STUCK_S or self.lag(measured) > 2.0 * self.max_lag:
            return True
        return not self.arrived(measured) and (
            resting_s > MAX_SETTLE_S or (resting_s > SETTLE_S and self.stands(measured))
        )

    def lag(self, measured: Measurements) -> float:
        """Distance of the joint from its setpoint."""
        return abs(self.joint.difference(self.position, measured.positions[self.joint.name]))

    def stands(self, measured: Measurements) -> bool:
        """Return True if the setpoint has come to rest and the joint has been measured in one place."""
        return self.at_rest and measured.standing_s.get(self.joint.name, 0.0) >= STANDSTILL_S
