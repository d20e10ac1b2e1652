"""Reads what a base says about how it drives."""

import math
from collections.abc import Callable, Iterable, Mapping
from typing import Any

from linked_fleet_agent.planar import DriveLimits, Pose
from linked_fleet_agent.wire.components import Component
from linked_fleet_gateway.extensions.components.state import ComponentState
from linked_fleet_gateway.extensions.components.terms import LF
from linked_fleet_state.driving import FollowedPath

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


def way_of(state: ComponentState, action: str, given: Mapping[str, Any]) -> FollowedPath | None:
    """Return the way on which an action leads a base; None for another component, and if the way is not known."""
    way = _WAYS.get(action) if is_base(state.declared) else None
    return None if way is None else way(state, given)


def _given_path(state: ComponentState, given: Mapping[str, Any]) -> FollowedPath:
    return followed_path(state, given["path"], bool(given.get("reverse")))


def _into_station(state: ComponentState, given: Mapping[str, Any]) -> FollowedPath | None:
    if (station := _station(state, given.get("station") or "")) is None:
        return None
    return FollowedPath((_front_of(station), _pose_of(station)), limits=drive_limits(state), docks=True)


def _out_of_station(state: ComponentState, given: Mapping[str, Any]) -> FollowedPath | None:
    at = state.value("dockedAt")
    station = _station(state, at) if at else None
    return None if station is None else FollowedPath((_front_of(station),), reverse=True, limits=drive_limits(state))


def _station(state: ComponentState, name: str) -> Mapping[str, Any] | None:
    """Return a station, the only one without a name; None if it, or the way into it, is not known."""
    known: list[Mapping[str, Any]] = state.value("stations") or []
    found = known if not name else [each for each in known if each["name"] == name]
    return found[0] if len(found) == 1 and "approach" in found[0] else None


def _pose_of(station: Mapping[str, Any]) -> Pose:
    return Pose(station["x"], station["y"], station["heading"])


def _front_of(station: Mapping[str, Any]) -> Pose:
    """Return where the straight way into a station begins."""
    return _pose_of(station).moved(-station["approach"], 0.0)


_WAYS: Mapping[str, Callable[[ComponentState, Mapping[str, Any]], FollowedPath | None]] = {
    "followPath": _given_path,
    "dock": _into_station,
    "undock": _out_of_station,
}


def _number(given: float | None) -> float:
    return math.nan if given is None else given
