"""A test that hangs fails by name with its stack, and the other tests go on; below Python it ends its worker."""

import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from running import ROOT

TESTS = """
import asyncio
import itertools
import threading

def test_that_hangs():
    HANG

def test_after_it():
    pass
"""


def _run(folder: Path, hang: str, *options: str) -> subprocess.CompletedProcess[str]:
    (folder / "pytest.ini").write_text(
        "[pytest]\ntimeout = 1\nfaulthandler_timeout = 3\nfaulthandler_exit_on_timeout = 1\n"
    )
    (folder / "test_one.py").write_text(TESTS.replace("HANG", hang))
    command = [sys.executable, "-m", "pytest", "-q", "-n", "1", "--dist", "loadfile", "-p", "no:schemathesis", *options]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=60)


@pytest.mark.parametrize("hang", ["threading.Event().wait()", "asyncio.run(asyncio.Event().wait())"])
def test_hanging_test_is_named_and_the_others_go_on(tmp_path: Path, hang: str) -> None:
    run = _run(tmp_path, hang)
    assert "FAILED test_one.py::test_that_hangs - Failed: Timeout" in run.stdout, run.stdout + run.stderr
    assert "1 failed, 1 passed" in run.stdout


def test_hang_below_python_ends_its_worker_and_is_named(tmp_path: Path) -> None:
    run = _run(tmp_path, "sum(itertools.repeat(0))", "--max-worker-restart=0")
    assert "crashed while running 'test_one.py::test_that_hangs'" in run.stdout, run.stdout + run.stderr
    assert "in test_that_hangs" in run.stderr


def test_all_runs_are_bounded() -> None:
    options = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["pytest"]["ini_options"]
    assert 0 < options["timeout"] < options["faulthandler_timeout"]
    assert options["faulthandler_exit_on_timeout"]
