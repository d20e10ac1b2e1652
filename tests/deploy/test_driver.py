"""The driver examples/door.py keeps the contract, and the contract rejects faulty drivers."""

import importlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest

from driver_contract import check_driver
from linked_fleet_agent.robot import Reading, RobotFaultError
from linked_fleet_agent.robots.catalogue import load
from running import process
from small_fleet import Place, faulty, live

ROOT = Path(__file__).parents[2]


@pytest.fixture
def door(monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    """Return the names of door.py, with its folder on the path."""
    monkeypatch.syspath_prepend(str(ROOT / "examples"))
    return vars(importlib.import_module("door"))


@pytest.mark.usefixtures("door")
def test_the_driver_of_the_example_keeps_the_contract(tmp_path: Path) -> None:
    """The test is that of examples/check_door.py."""
    importlib.import_module("check_door").test_my_driver(tmp_path)
    assert (tmp_path / "enable").read_text() == "0"


def test_its_fault_is_told(door: dict[str, Any], tmp_path: Path) -> None:
    with pytest.raises(RobotFaultError, match="potentiometer"):
        door["Door"](tmp_path, tmp_path / "angle").read(0.0)


def test_a_simulated_robot_keeps_the_contract() -> None:
    check_driver(load("ur5", "ur5"))


def _unlimited(door: Any, tmp_path: Path) -> Any:
    class Unlimited(door):  # type: ignore[misc]
        def apply(self, setpoints: Mapping[str, float]) -> Mapping[str, float]:
            super().apply(setpoints)
            return dict(setpoints)

    return Unlimited(tmp_path, tmp_path / "angle")


def _forgetful(door: Any, tmp_path: Path) -> Any:
    class Forgetful(door):  # type: ignore[misc]
        def read(self, now_s: float) -> Reading:
            return Reading((), (), ())

    return Forgetful(tmp_path, tmp_path / "angle")


@pytest.mark.parametrize(("broken", "reason"), [(_unlimited, "within the limits"), (_forgetful, "one value for each")])
def test_the_contract_detects_invalid_drivers(door: dict[str, Any], tmp_path: Path, broken: Any, reason: str) -> None:
    (tmp_path / "angle").write_text("0")
    with pytest.raises(AssertionError, match=reason):
        check_driver(broken(door["Door"], tmp_path))


def test_a_robot_that_does_not_move_is_found_out(door: dict[str, Any], tmp_path: Path) -> None:
    (tmp_path / "angle").write_text("0")
    with pytest.raises(AssertionError, match="did not get there"):
        check_driver(door["Door"](tmp_path, tmp_path / "angle"))


@pytest.mark.processes
@pytest.mark.test_all
def test_a_robot_that_is_switched_on_after_its_agent_comes_online_by_itself(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    place, angle = Place(tmp_path / "state"), tmp_path / "angle"
    monkeypatch.setenv("DOOR_PWM", str(tmp_path))
    monkeypatch.setenv("DOOR_ANGLE", str(angle))
    with place.gateway() as (_, browser), process("examples/door.py", "--connect", place.zenoh) as agent:
        assert "potentiometer cannot be read" in faulty(browser, "door")
        angle.write_text("0")
        live(browser, "door")
        agent.said("the robot can be read again")
