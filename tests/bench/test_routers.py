"""The bench of a tree of routers runs with a few robots, and leaves nothing behind."""

import os
import subprocess
import sys

import pytest

from bench.namespaces import full_name, ip, namespaces
from bench.table import UnavailableError
from running import ROOT

pytestmark = [pytest.mark.processes, pytest.mark.test_all]
_BENCH = [
    sys.executable,
    "-m",
    "bench.routers",
    "--robots",
    "80",
    "--namespaces",
    "2",
    "--joints",
    "3",
    "--requests",
    "4",
    "--seconds",
    "2",
]


def _run(**environment: str) -> subprocess.CompletedProcess[str]:
    paths = {"PYTHONPATH": ".:tests:tests/support"}
    return subprocess.run(
        _BENCH, cwd=ROOT, env={**os.environ, **paths, **environment}, capture_output=True, text=True, check=True
    )


def _rows(said: str) -> dict[str, list[str]]:
    """Figures by the name of their row."""
    lines = [line.strip("|").split("|") for line in said.splitlines() if line.startswith("| ")]
    return {name.strip(): [each.strip() for each in figures] for name, *figures in lines}


def test_every_gateway_has_every_robot_and_a_lost_region_comes_back() -> None:
    try:
        with namespaces() as environment:
            pass
    except UnavailableError as error:
        pytest.skip(str(error))
    rows = _rows(_run(**environment).stdout)
    assert rows["keeps: robots"] == ["40"] * 3
    assert rows["declares: tokens, queryables, subscribers"] == ["1, 0, 5"] * 3, "not one thing for each robot"
    assert rows["— robots of the area online at its own gateway meanwhile"] == ["20"]
    assert rows["— a command there meanwhile: status"] == ["204"]
    assert rows["— robots elsewhere that are online then"] == ["20"]
    assert float(rows["— until all robots are at its own gateway, s"][0]) > 0
    assert full_name("") not in ip("netns", "list")


def test_without_the_command_ip_it_says_that_it_is_skipped(tmp_path: os.PathLike[str]) -> None:
    assert _run(PATH=str(tmp_path)).stdout.startswith("skipped: network namespaces need the command ip")
