"""A failure is reported even if garbage collection parses Python meanwhile."""

import subprocess
import sys
from pathlib import Path

from running import ROOT

CONFIGURATION = f"""
[pytest]
pythonpath = {ROOT / "tests/support"}
addopts = -p no:cacheprovider -p no:schemathesis -p failure_reports
"""
TESTS = """
import ast
import gc
import pytest

@pytest.fixture
def frequent():
    yield
    gc.callbacks.clear()

def test_that_fails(frequent):
    gc.callbacks.append(lambda *_: ast.parse("f(a)"))
    gc.set_threshold(1, 1, 1)
    raise OSError("the reason")

def test_after_it():
    assert gc.isenabled()
"""


def test_failure_is_reported_despite_garbage_collection(tmp_path: Path) -> None:
    (tmp_path / "pytest.ini").write_text(CONFIGURATION)
    (tmp_path / "test_one.py").write_text(TESTS)
    run = subprocess.run([sys.executable, "-m", "pytest", "-q"], cwd=tmp_path, capture_output=True, text=True)
    assert "FAILED test_one.py::test_that_fails - OSError: the reason" in run.stdout, run.stdout + run.stderr
    assert "1 failed, 1 passed" in run.stdout
