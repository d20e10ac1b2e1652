"""Faults of a gateway: noted, logged once, and gone when they end."""

import logging

import pytest

from linked_fleet_base.faults import MAX_FAULTS, Faults


def fail(faults: Faults, part: str = "a face", robot: str = "r", thing: str = "", error: str = "planted") -> None:
    with faults.guard(part, robot, thing):
        raise RuntimeError(error)


@pytest.mark.parametrize(
    ("robot", "thing", "reason"),
    [
        ("r", "", "a face cannot describe r: RuntimeError: planted"),
        ("r", "its row", "a face cannot describe its row of r: RuntimeError: planted"),
        ("", "added", "a face: added failed: RuntimeError: planted"),
    ],
)
def test_a_fault_is_noted_with_its_reason_until_a_success(robot: str, thing: str, reason: str) -> None:
    faults = Faults()
    fail(faults, robot=robot, thing=thing)
    assert faults.find("a face", robot, thing) == reason
    assert (faults.of_parts, faults.robots) == (([], {"r"}) if robot else ([reason], set()))
    assert faults.counts() == {"a face": 1}
    with faults.guard("a face", robot, thing):
        pass
    assert (faults.find("a face", robot, thing), faults.counts()) == ("", {})


def test_a_fault_is_logged_once(caplog: pytest.LogCaptureFixture) -> None:
    faults = Faults()
    for error in ("first", "first", "first", "second"):
        fail(faults, error=error)
    logged = [each.getMessage() for each in caplog.records if each.levelno == logging.ERROR]
    assert [each.partition("Error: ")[2] for each in logged] == ["first (logged once)", "second (logged once)"]


def test_faults_of_robots_that_left_are_forgotten() -> None:
    faults = Faults()
    for robot in ("here", "gone", ""):
        fail(faults, robot=robot, thing="x")
    faults.forget_others({"here"})
    assert faults.robots == {"here"} and len(faults.of_parts) == 1


def test_the_number_of_faults_is_bounded() -> None:
    faults = Faults()
    for number in range(MAX_FAULTS + 5):
        fail(faults, robot=f"r{number}", error="x" * 10_000)
    assert len(faults.robots) == MAX_FAULTS
    assert len(faults.find("a face", f"r{MAX_FAULTS}")) <= 300


def test_the_end_of_a_task_passes() -> None:
    faults = Faults()
    with pytest.raises(KeyboardInterrupt), faults.guard("a face", "r"):
        raise KeyboardInterrupt
    assert not faults.counts()
