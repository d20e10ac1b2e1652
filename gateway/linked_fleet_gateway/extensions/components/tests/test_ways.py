"""The ways of bases by their actions, as the check of motions gets them."""

from typing import Any

import pytest
from msgspec.structs import replace

from linked_fleet_agent.planar import DriveLimits, Pose
from linked_fleet_agent.wire.kinds import KINDS, LF
from linked_fleet_gateway.extensions.components.bases import way_of
from linked_fleet_gateway.extensions.components.state import ComponentState
from linked_fleet_state.driving import FollowedPath

EAST = {"name": "east", "x": 1.0, "y": 2.0, "heading": 0.0, "approach": 0.4}
WEST = EAST | {"name": "west", "x": -1.0}
LIMITS = DriveLimits(linear=1.0, angular=1.5, linear_acceleration=1.0, angular_acceleration=2.0)
INTO = FollowedPath((Pose(0.6, 2, 0), Pose(1, 2, 0)), limits=LIMITS, docks=True)
OWN_WAY = {name: each for name, each in EAST.items() if name != "approach"}


def base(stations: list[dict[str, Any]] | None, at: str | None = "") -> ComponentState:
    limits = {"linear": 1, "lateral": 0, "angular": 1.5, "linearAcceleration": 1, "angularAcceleration": 2}
    values = {"stations": stations, "dockedAt": at, "driveLimits": limits}
    return ComponentState(KINDS[LF + "Base"].least, values)


@pytest.mark.parametrize(
    ("state", "action", "given", "way"),
    [
        (base([EAST]), "dock", {}, INTO),
        (base([WEST, EAST]), "dock", {"station": "east"}, INTO),
        (base([WEST, EAST], "east"), "undock", {}, FollowedPath((Pose(0.6, 2, 0),), reverse=True, limits=LIMITS)),
        (
            base([]),
            "followPath",
            {"path": [{"x": 1, "y": 2, "heading": 3}], "reverse": True},
            FollowedPath((Pose(1, 2, 3),), reverse=True, limits=LIMITS),
        ),
    ],
)
def test_an_action_of_a_base_has_its_way(
    state: ComponentState, action: str, given: dict[str, Any], way: FollowedPath
) -> None:
    assert way_of(state, action, given) == way


@pytest.mark.parametrize(
    ("state", "action", "given"),
    [
        (base(None), "dock", {}),
        (base([]), "dock", {}),
        (base([EAST, WEST]), "dock", {}),
        (base([EAST]), "dock", {"station": "west"}),
        (base([OWN_WAY]), "dock", {}),
        (base([OWN_WAY], "east"), "undock", {}),
        (base([EAST]), "undock", {}),
        (base([EAST], None), "undock", {}),
        (base([EAST]), "dance", {}),
    ],
)
def test_a_way_that_is_not_known_is_none(state: ComponentState, action: str, given: dict[str, Any]) -> None:
    assert way_of(state, action, given) is None


def test_what_is_no_base_has_no_way() -> None:
    other = replace(KINDS[LF + "Base"].least, semantic_type="")
    assert way_of(ComponentState(other, {"stations": [EAST]}), "dock", {}) is None
