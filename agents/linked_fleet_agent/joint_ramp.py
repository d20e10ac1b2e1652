"""Velocities of several joints that change together, as agents ramp them and gateways expect it. Pure; by joint, SI."""

from collections.abc import Mapping

Velocities = Mapping[str, float]


def ramp_s(now: Velocities, wanted: Velocities, accelerations: Velocities) -> float:
    """Return how long all joints take to change their velocities; a joint that is left out has none."""
    changes = (abs(wanted.get(name, 0.0) - now.get(name, 0.0)) / most for name, most in accelerations.items())
    return max(changes, default=0.0)


def toward(now: Velocities, wanted: Velocities, accelerations: Velocities, elapsed_s: float) -> dict[str, float]:
    """Return the velocities after ``elapsed_s``. All joints arrive together, so that a hand keeps its line."""
    needed_s = ramp_s(now, wanted, accelerations)
    share = 1.0 if needed_s <= elapsed_s else elapsed_s / needed_s
    return {name: (at := now.get(name, 0.0)) + share * (wanted.get(name, 0.0) - at) for name in accelerations}
