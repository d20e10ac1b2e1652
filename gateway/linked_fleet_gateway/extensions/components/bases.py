"""What a base says about how it drives."""

import math
from collections.abc import Iterable, Mapping
from typing import Any

from linked_fleet_agent.planar import DriveLimits, Pose
from linked_fleet_agent.wire.components import Component
from linked_fleet_gateway.extensions.components.state import ComponentState
from linked_fleet_gateway.extensions.components.terms import LF
from linked_fleet_gateway.fleet.driving import FollowedPath

_BASE = LF.extended("Base").Base.value


def is_base(declared: Component) -> bool:
    return declared.semantic_type == _BASE


def drive_limits(state: ComponentState) -> DriveLimits | None:
    """Return the limits of a base; None if it does not say how it brakes."""
    if not (most := state.value("driveLimits")):
        return None
    try:
        return DriveLimits(
            most["linear"], most["angular"], most["linearAcceleration"], most["angularAcceleration"], most["lateral"]
        )
    except ValueError:
        return None


def followed_path(state: ComponentState, path: Iterable[Mapping[str, Any]], reverse: bool = False) -> FollowedPath:
    """Return the path of a base through these poses, of which a heading may be missing."""
    poses = tuple(Pose(each["x"], each["y"], _number(each.get("heading"))) for each in path)
    return FollowedPath(poses, reverse, drive_limits(state))


def _number(given: float | None) -> float:
    return math.nan if given is None else given
