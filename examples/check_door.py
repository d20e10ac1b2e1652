"""A driver keeps the contract of drivers: run by pytest, with a simulated door instead of the devices of door.py."""

from pathlib import Path

from door import Door

from driver_contract import check_driver


def test_my_driver(tmp_path: Path) -> None:
    (tmp_path / "angle").write_text("0")

    def live(now_s: float) -> None:  # whatever the robot does by itself between two readings
        nanoseconds = int((tmp_path / "duty_cycle").read_text()) if (tmp_path / "duty_cycle").exists() else 1_000_000
        (tmp_path / "angle").write_text(str(round((nanoseconds - 1_000_000) / 1_000_000 * 4095)))

    check_driver(Door(tmp_path, tmp_path / "angle"), live, tolerance=1e-3)
