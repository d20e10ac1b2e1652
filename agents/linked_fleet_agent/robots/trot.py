"""The trot of a robot with four legs: where its feet are at a phase, and the joint positions for that. Pure.

Diagonal legs step together. A foot on the ground moves against the velocity of the base; one in the air goes to where
it stands best for the next step. SI units, in the frame of the base: x forward, y to the left, z up.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

from linked_fleet_agent.planar import STANDING, Pose, Velocity

PERIOD_S, AIR_SHARE, LIFT_M = 0.3, 0.45, 0.04
"""Time of one stride, the share of it that a foot is in the air, and how high it is lifted."""
_CORRECTS_S, _FINISHES_S = PERIOD_S, 2.0 * PERIOD_S
"""For so long after its velocity is zero it corrects where it is; then all feet have stepped to their stand."""
SETTLES_S = _FINISHES_S + PERIOD_S / 2.0
"""After this time without velocity it stands."""
_MOST_STEP_M = 0.12
_MOST_LED_M, _MOST_LED_RAD = 0.1, 0.3
_LED_1_S, _TURNED_1_S, _CAUGHT_S = 1.0, 2.0, 0.05


class Foot(NamedTuple):
    """The position of a foot, from the origin of its hip."""

    x: float
    y: float
    z: float


@dataclass(frozen=True)
class Leg:
    """A leg: its hip in the frame of the base, the distance of its thigh to the side, the lengths of thigh and calf.

    ``phase`` is the share of the stride by which it steps after the first leg.
    """

    name: str
    hip: tuple[float, float]
    aside: float
    thigh: float
    calf: float
    phase: float

    def foot(self, hip: float, thigh: float, calf: float) -> Foot:
        """Return where the foot is for these positions of the joints."""
        forward = -self.thigh * math.sin(thigh) - self.calf * math.sin(thigh + calf)
        down = self.thigh * math.cos(thigh) + self.calf * math.cos(thigh + calf)
        cosine, sine = math.cos(hip), math.sin(hip)
        return Foot(forward, self.aside * cosine + down * sine, self.aside * sine - down * cosine)

    def joints(self, foot: Foot) -> tuple[float, float, float]:
        """Return the positions of hip, thigh and calf that bring the foot there, or as near as the leg reaches."""
        down = math.sqrt(max(foot.y**2 + foot.z**2 - self.aside**2, 1e-6))
        hip = math.atan2(foot.y, -foot.z) - math.atan2(self.aside, down)
        square = foot.x**2 + down**2
        bent = (square - self.thigh**2 - self.calf**2) / (2.0 * self.thigh * self.calf)
        calf = -math.acos(min(max(bent, -0.95), 0.66))
        thigh = math.atan2(-foot.x, down) - math.atan2(
            self.calf * math.sin(calf), self.thigh + self.calf * math.cos(calf)
        )
        return hip, thigh, calf


class Trot:
    """The steps of four legs, which begin with a velocity, and end with all feet where they stood before.

    The base is led to where its velocities would have brought it, so that slipping feet do not let it drift.
    """

    def __init__(self, legs: Sequence[Leg]) -> None:
        self.legs, self.walking = legs, False
        self._stand = [Foot(0.0, 0.0, 0.0)] * len(legs)
        self._steps = [_Step() for _ in legs]
        self._phase = self._idle_s = 0.0
        self._led = Pose()

    def begin(self, positions: Sequence[tuple[float, float, float]], pose: Pose) -> None:
        """Walk from a stand with these positions of the joints of each leg."""
        self._stand = [leg.foot(*each) for leg, each in zip(self.legs, positions, strict=True)]
        self._steps = [_Step() for _ in self.legs]
        self._phase, self._idle_s, self._led, self.walking = 0.0, 0.0, pose, True

    def step(
        self, elapsed_s: float, wanted: Velocity, pose: Pose, velocity: Velocity
    ) -> list[tuple[float, float, float]]:
        """Return the positions of the joints of each leg after ``elapsed_s``."""
        self._phase = (self._phase + elapsed_s / PERIOD_S) % 1.0
        self._idle_s = 0.0 if wanted != STANDING else self._idle_s + elapsed_s
        led = self._lead(elapsed_s, wanted, pose) if self._idle_s < _CORRECTS_S else STANDING
        error = Velocity(velocity.linear - wanted.linear, velocity.lateral - wanted.lateral)
        joints = [
            self._of_leg(leg, step, stand, elapsed_s, led, error)
            for leg, step, stand in zip(self.legs, self._steps, self._stand, strict=True)
        ]
        if self._idle_s >= _FINISHES_S and all(step.share == 0.0 for step in self._steps):
            self.walking = False
            return [leg.joints(stand) for leg, stand in zip(self.legs, self._stand, strict=True)]
        return joints

    def _lead(self, elapsed_s: float, wanted: Velocity, pose: Pose) -> Velocity:
        """Return the velocity that also brings the base back to where it should be."""
        linear, lateral, angular = (each * elapsed_s for each in wanted)
        self._led = self._led.moved(linear, angular, lateral)
        x, y = self._led.x - pose.x, self._led.y - pose.y
        far = max(math.hypot(x, y) / _MOST_LED_M, 1.0)
        x, y = x / far, y / far
        turn = math.remainder(self._led.heading - pose.heading, math.tau)
        turn = min(max(turn, -_MOST_LED_RAD), _MOST_LED_RAD)
        self._led = Pose(pose.x + x, pose.y + y, pose.heading + turn)
        cosine, sine = math.cos(pose.heading), math.sin(pose.heading)
        return Velocity(
            wanted.linear + _LED_1_S * (x * cosine + y * sine),
            wanted.lateral + _LED_1_S * (y * cosine - x * sine),
            wanted.angular + _TURNED_1_S * turn,
        )

    def _of_leg(
        self, leg: Leg, step: "_Step", stand: Foot, elapsed_s: float, led: Velocity, error: Velocity
    ) -> tuple[float, float, float]:
        x, y = leg.hip[0] + stand.x, leg.hip[1] + stand.y
        over = led.linear - led.angular * y, led.lateral + led.angular * x  # velocity of the base above the foot
        phase = (self._phase + leg.phase) % 1.0
        if phase < AIR_SHARE:
            there = _landing(over[0], error.linear), _landing(over[1], error.lateral)
            step.swing(phase / AIR_SHARE, there)
        else:
            step.push(-over[0] * elapsed_s, -over[1] * elapsed_s)
        lifted = LIFT_M * 4.0 * step.share * (1.0 - step.share)
        return leg.joints(Foot(stand.x + step.x, stand.y + step.y, stand.z + lifted))


class _Step:
    """The place of a foot from its stand, and the share of its way through the air; zero on the ground."""

    def __init__(self) -> None:
        self.x = self.y = self.share = 0.0
        self._from = (0.0, 0.0)

    def swing(self, share: float, there: tuple[float, float]) -> None:
        if self.share == 0.0:
            self._from = (self.x, self.y)
        self.share = max(share, 1e-6)
        smooth = share**2 * (3.0 - 2.0 * share)
        self.x, self.y = (start + (end - start) * smooth for start, end in zip(self._from, there, strict=True))

    def push(self, x: float, y: float) -> None:
        self.share = 0.0
        self.x, self.y = (min(max(each, -_MOST_STEP_M), _MOST_STEP_M) for each in (self.x + x, self.y + y))


def _landing(over: float, error: float) -> float:
    """Return how far ahead of its stand a foot lands: half of the way that it then pushes, and more after an error."""
    there = over * (1.0 - AIR_SHARE) * PERIOD_S / 2.0 + _CAUGHT_S * error
    return min(max(there, -_MOST_STEP_M), _MOST_STEP_M)
