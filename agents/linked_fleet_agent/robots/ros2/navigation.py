"""Navigation of ROS robots: where the base is on the map of Nav2, drives to poses of it, and docking."""

import math
import time
from collections.abc import Mapping
from typing import Annotated, Any

from msgspec import Meta, Struct

from linked_fleet_agent.components.call import Call
from linked_fleet_agent.components.component import Component, action, value
from linked_fleet_agent.components.kinds import Metres, PlanarPose
from linked_fleet_agent.components.schemas import unit
from linked_fleet_agent.robots.ros2.base import Whereabouts
from linked_fleet_agent.robots.ros2.goal_runs import run_goal
from linked_fleet_agent.robots.ros2.goals import ActionClient
from linked_fleet_agent.wire.components import BASE

NAVIGATE, DOCK, UNDOCK = (f"nav2_msgs/action/{each}" for each in ("NavigateToPose", "DockRobot", "UndockRobot"))
ACTIONS = (NAVIGATE, DOCK, UNDOCK)
LONGEST_S, STOP_S = 3600.0, 5.0
_Metres = Annotated[float, unit("M"), Meta(ge=-1e5, le=1e5)]
_Heading = Annotated[float, unit("RAD"), Meta(title="Heading, counterclockwise")]
_Seconds = Annotated[float, unit("SEC")]
_DockingState = Annotated[int, Meta(title="State of the docking server")]
_DockName = Annotated[str, Meta(min_length=1, max_length=64, title="Name of the dock")]


class Underway(Struct, rename="camel"):
    """The progress of a drive."""

    distance_remaining: Annotated[Metres, Meta(title="Remaining distance")]
    navigation_time: Annotated[_Seconds, Meta(title="Time since the start")]
    time_remaining: Annotated[_Seconds, Meta(title="Estimated remaining time")]
    recoveries: int


class RosNavigation(Component, rename="camel", blocking=False):
    """Navigation by Nav2, which plans ways on its own map, and keeps off what its sensors see.

    Gateways do not know its ways: they do not check them.
    """

    name = "navigation"

    def __init__(self, whereabouts: Whereabouts | None, navigate: ActionClient) -> None:
        self._whereabouts, self._navigate = whereabouts, navigate

    @value
    def map_pose(self) -> PlanarPose:
        """Return where the base is on the map."""
        found = None if self._whereabouts is None else self._whereabouts.on_map(time.monotonic())
        if found is None:
            raise ValueError("no frame called map has told lately where the base is")
        return PlanarPose(round(found.position[0], 4), round(found.position[1], 4), round(found.heading, 4))

    @action(moves=(BASE,), duration_s=LONGEST_S, stop_s=STOP_S)
    async def navigate_to_pose(self, call: Call[Underway], x: _Metres, y: _Metres, heading: _Heading = 0.0) -> None:
        """Drive to a pose on the map, round what is in the way."""
        goal = {"pose": _pose(x, y, heading)}
        await run_goal(call, self._navigate, goal, lambda said: call.feedback(_underway(said)))


class DockingNavigation(RosNavigation):
    """Navigation by Nav2, which plans ways on its own map, and docks the robot.

    Gateways do not know its ways: they do not check them.
    """

    def __init__(
        self, whereabouts: Whereabouts | None, navigate: ActionClient, dock: ActionClient, undock: ActionClient
    ) -> None:
        super().__init__(whereabouts, navigate)
        self._dock, self._undock = dock, undock

    @action(moves=(BASE,), duration_s=LONGEST_S, stop_s=STOP_S)
    async def dock_robot(self, call: Call[_DockingState], dock: _DockName) -> None:
        """Drive to a dock that the docking server knows, and dock there."""
        goal = {"use_dock_id": True, "dock_id": dock, "navigate_to_staging_pose": True, "max_staging_time": 1000.0}
        await run_goal(call, self._dock, goal, lambda said: call.feedback(said["state"]))

    @action(moves=(BASE,), duration_s=LONGEST_S, stop_s=STOP_S)
    async def undock_robot(self, call: Call) -> None:  # type: ignore[type-arg]
        """Leave the dock."""
        await run_goal(call, self._undock, {"max_undocking_time": 60.0}, lambda said: None)


def navigation_of(
    whereabouts: Whereabouts | None, navigate: ActionClient, dock: ActionClient | None, undock: ActionClient | None
) -> RosNavigation:
    """Return the component of a base that Nav2 drives, with docking if it is offered."""
    if dock is None or undock is None:
        return RosNavigation(whereabouts, navigate)
    return DockingNavigation(whereabouts, navigate, dock, undock)


def _pose(x: float, y: float, heading: float) -> dict[str, Any]:
    turned = {"z": math.sin(heading / 2.0), "w": math.cos(heading / 2.0)}
    return {"header": {"frame_id": "map"}, "pose": {"position": {"x": x, "y": y}, "orientation": turned}}


def _underway(said: Mapping[str, Any]) -> Underway:
    return Underway(
        round(float(said["distance_remaining"]), 3),
        _seconds(said["navigation_time"]),
        _seconds(said["estimated_time_remaining"]),
        said["number_of_recoveries"],
    )


def _seconds(said: Mapping[str, Any]) -> float:
    return round(float(said["sec"] + said["nanosec"] / 1e9), 2)
