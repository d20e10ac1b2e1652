"""The members of a base that docks at charging stations: it drives in front of one, straight in, and back out."""

import math
from collections.abc import Awaitable, Callable, Iterable, Sequence
from typing import Annotated, Any, Protocol

from msgspec import Meta

from linked_fleet_agent.components.call import Call
from linked_fleet_agent.components.component import action, value
from linked_fleet_agent.components.kinds import Docked, PlanarPose, Station, StationName
from linked_fleet_agent.components.path_following import Driving, duration_s, error_of, stand, track
from linked_fleet_agent.path_tracking import PathError, Tracker
from linked_fleet_agent.planar import DriveLimits, Pose

DOCKING_M_S = 0.1
"""The most that a base drives on the straight way into a station, and out of it."""
NEAR_M = 2.0
"""A base that is further from a station does not dock there: it would drive a long way without a plan."""
MOST_STATIONS = 16
_BEHIND_M = 0.02
_CONTACT_S = 1.0
"""The time that the contact has to be noticed."""
_LONGEST_S = 300.0
Stations = Annotated[list[Station], Meta(max_length=MOST_STATIONS, title="Charging stations")]
DockedAt = Annotated[str, Meta(max_length=64, title="Station where the base is docked")]


class Docking(Driving, Protocol):
    """The members of a base that takes velocities which these actions need."""

    def known_stations(self) -> Sequence[Station]: ...
    def station_in_contact(self) -> str: ...
    async def carry_out(self, call: Call[Any], drive: Callable[[], Awaitable[None]]) -> None: ...


class _Part:
    """Reports a part of a way as one of the whole."""

    def __init__(self, call: Call[PlanarPose], first: float, share: float, reason: str) -> None:
        self._call, self._first, self._share, self._reason = call, first, share, reason

    def progress(self, share: float, /) -> None:
        self._call.progress(self._first + share * self._share, self._reason)

    def feedback(self, value: PlanarPose, /) -> None:
        self._call.feedback(value)


def pose_of(station: Station) -> Pose:
    return Pose(station.x, station.y, station.heading)


def station_at(pose: Pose, stations: Iterable[Station], within_m: float, within_rad: float) -> str:
    """Return the name of the station whose pose is so near, or an empty text."""
    for each in stations:
        distance_m, turn_rad = pose_of(each).error_of(pose)
        if distance_m <= within_m and turn_rad <= within_rad:
            return each.name
    return ""


def front_of(station: Station) -> Pose:
    """Return where the straight way into a station begins."""
    return pose_of(station).moved(-station.approach, 0.0)


def station_of(base: Docking, name: str) -> Station:
    """Return a station, the only one without a name. Raises ValueError."""
    known = {each.name: each for each in base.known_stations()}
    if not name and len(known) == 1:
        return next(iter(known.values()))
    if name not in known:
        said = f"there is no station {name!r}" if name else "say at which station"
        raise ValueError(f"{said}; this base knows {', '.join(known) or 'none'}")
    return known[name]


def check_start(base: Docking, station: Station) -> None:
    """Raise ValueError if the base cannot dock from where it is."""
    if at := base.station_in_contact():
        raise ValueError(f"the base is docked at {at!r}; undock it first")
    distance_m, _ = pose_of(station).error_of(base.pose_now)
    if distance_m > NEAR_M:
        said = f"the base is {distance_m:.1f} m from the station {station.name!r}"
        raise ValueError(f"{said}; drive it within {NEAR_M:g} m of that first")
    if pose_of(station).ahead_m(base.pose_now) > _BEHIND_M:
        raise ValueError(f"the base is behind the station {station.name!r}; drive it in front of that first")


def docking_s(base: Docking, station: Station) -> tuple[float, float]:
    """Return how long the way in front of a station takes, and the one into it."""
    front, share = front_of(station), base.speed_share
    into = Tracker(front, [pose_of(station)], base.limits, _slow(base.limits) * share)
    return duration_s(base, [front], 1.0, _backwards(base, front)), into.duration_s


def docked(base: Docking, station: Station) -> Docked:
    """Return the result: how the base stands now."""
    arrived = error_of(base.pose_now, pose_of(station))
    return Docked(arrived.error, arrived.heading_error, station.name)


def _backwards(base: Docking, front: Pose) -> bool:
    """Return True if the base drives backwards to where the straight way begins, because that is behind it."""
    return not base.limits.lateral and base.pose_now.ahead_m(front) < 0.0


def _slow(limits: DriveLimits) -> float:
    return min(DOCKING_M_S / limits.linear, 1.0)


async def drive_in(base: Docking, call: Call[PlanarPose], station: Station) -> None:
    """Drive in front of a station, turn to it, and drive straight in. Raises PathError if there is no contact then."""
    await stand(base)
    front, (there_s, into_s) = front_of(station), docking_s(base, station)
    share = there_s / (there_s + into_s)
    before = _Part(call, 0.0, share, f"in front of {station.name}")
    await track(base, before, [front], reverse=_backwards(base, front))
    into = _Part(call, share, 1.0 - share, f"into {station.name}")
    await track(base, into, [pose_of(_seen(base, station))], _slow(base.limits))
    await _touch(base, station)


def _seen(base: Docking, station: Station) -> Station:
    """Return the station as the base sees it now, which it may see better from near. Raises PathError."""
    try:
        return station_of(base, station.name)
    except ValueError as error:
        raise PathError(f"the station is not seen any more: {error}") from error


async def _touch(base: Docking, station: Station) -> None:
    until_s = await base.tick() + _CONTACT_S
    while base.station_in_contact() != station.name:
        if await base.tick() > until_s:
            off = docked(base, _seen(base, station))
            raise PathError(
                f"there is no contact with the station {station.name!r}: the base stands {off.error:.3f} m and "
                f"{math.degrees(off.heading_error):.1f}° off its pose; dock it again"
            )


def back_of(base: Docking) -> Pose:
    """Return where the base stands when it is undocked. Raises ValueError if it is not docked."""
    at = base.station_in_contact()
    if not at:
        raise ValueError("the base is not docked")
    return base.pose_now.moved(-station_of(base, at).approach, 0.0)


def docking(limits: DriveLimits, moves: Sequence[str], stop_s: float) -> dict[str, Any]:
    """Return the values and actions for a base with these limits, by name; it takes so long to come to rest."""

    def stations(self: Any) -> Stations:
        """Return the charging stations: the poses of the base in the odometry frame when it is docked."""
        return list(self.known_stations())

    def docked_at(self: Any) -> DockedAt:
        """Return the name of the station that charges the base, empty if none does."""
        return str(self.station_in_contact())

    def rehearse_dock(self: Any, station: StationName = "") -> float:
        target = station_of(self, station)
        if self.station_in_contact() == target.name:
            return 0.0
        check_start(self, target)
        return sum(docking_s(self, target))

    async def dock(self: Any, call: Call[PlanarPose], station: StationName = "") -> Docked:
        """Drive straight in front of a charging station, the only one by default, turn to it, and drive in slowly.

        The base drives backwards to where the straight way begins if that is behind it.
        """
        target = station_of(self, station)
        if self.station_in_contact() != target.name:
            check_start(self, target)
            await self.carry_out(call, lambda: drive_in(self, call, target))
        return docked(self, _seen(self, target))

    def rehearse_undock(self: Any) -> float:
        return duration_s(self, [back_of(self)], _slow(limits), reverse=True)

    async def undock(self: Any, call: Call[PlanarPose]) -> None:
        """Drive straight back out of a charging station, slowly."""
        back = back_of(self)
        await self.carry_out(call, lambda: track(self, call, [back], _slow(limits), reverse=True))

    def offered(rehearse: Callable[..., float]) -> Callable[[Any], Any]:
        return action(moves=moves, duration_s=_LONGEST_S + stop_s, stop_s=stop_s, rehearse=rehearse)

    return {
        "stations": value(stations),
        "docked_at": value(docked_at),
        "dock": offered(rehearse_dock)(dock),
        "undock": offered(rehearse_undock)(undock),
    }
