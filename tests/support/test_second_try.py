"""A test with processes that fails has one second try, which the end of the run names; others have none."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from running import ROOT
from second_try import TITLE, TWICE

CONFIGURATION = f"""
[pytest]
filterwarnings = error
pythonpath = {ROOT / "tests/support"}
addopts = -p no:cacheprovider
markers = processes
"""
FIXTURES = """
import pytest
from pathlib import Path
from second_try import add_option as pytest_addoption
from second_try import pytest_itemcollected, pytest_terminal_summary

LOG = Path(__file__).with_name("log")

def note(text):
    with LOG.open("a") as log:
        log.write(text + "\\n")
    return LOG.read_text().splitlines().count(text)

def kept(scope):
    @pytest.fixture(scope=scope)
    def fixture(request):
        name = f"{scope} of {request.path.stem}" if scope != "session" else scope
        note(f"{name} begins")
        yield {"open": True}
        note(f"{name} ends")
    return fixture

session, module, function = kept("session"), kept("module"), kept("function")

@pytest.fixture(scope="module")
def late():
    if note("late begins") == 1:
        raise OSError("not yet")
    yield {"open": True}
    note("late ends")

@pytest.fixture
def noted():
    return note
"""
TESTS = """
import pytest

pytestmark = pytest.mark.processes

def test_before(session, module, function):
    pass

def test_fails_once(session, module, function, noted):
    assert session["open"] and module["open"]
    assert noted("attempt") == 2

def test_fails_once_with_what_it_needs(late):
    assert late["open"]

def test_fails_twice(session, module, function, noted):
    raise AssertionError(f"try {noted('vain')}")

def test_is_the_last_and_fails_once(session, module, noted):
    assert session["open"] and module["open"]
    assert noted("last attempt") == 2
"""
OTHER = """
def test_of_another_file(session, module):
    assert session["open"] and module["open"]

def test_has_no_processes(noted):
    assert noted("only attempt") == 2
"""


@pytest.mark.parametrize("workers", [(), ("-n", "1", "--dist", "loadscope")], ids=["one process", "a worker"])
def test_one_second_try_with_fixtures_that_stay(tmp_path: Path, workers: tuple[str, ...]) -> None:
    """Fixtures of modules and of the session are reused for the second try; those of functions are created again."""
    for name, text in (
        ("pytest.ini", CONFIGURATION),
        ("conftest.py", FIXTURES),
        ("test_first.py", TESTS),
        ("test_second.py", OTHER),
    ):
        (tmp_path / name).write_text(text)
    environment = {name: value for name, value in os.environ.items() if not name.startswith(("PYTEST_", "COV_"))}
    command = [sys.executable, "-m", "pytest", *_options(), *workers, str(tmp_path)]
    run = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True)
    assert run.returncode == 1, run.stdout + run.stderr
    assert re.findall(rf"^{TITLE}: .*::(\w+)$", run.stdout, re.M) == [
        "test_fails_once",
        "test_fails_once_with_what_it_needs",
        "test_is_the_last_and_fails_once",
    ]
    assert re.findall(rf"^{TWICE}: .*::(\w+)$", run.stdout, re.M) == ["test_fails_twice"]
    assert "AssertionError: try 1" in run.stdout
    assert re.findall(r"^FAILED .*::(\w+)", run.stdout, re.M) == [
        "test_fails_twice",
        "test_has_no_processes",
    ]
    assert re.search(r"2 failed, 5 passed, 4 rerun", run.stdout)
    assert "OSError: not yet" in run.stdout
    log = (tmp_path / "log").read_text().splitlines()
    assert log.count("vain") == 2
    for name in ("session", "module of test_first", "module of test_second"):
        assert (log.count(f"{name} begins"), log.count(f"{name} ends")) == (1, 1), log
    assert log.count("function of test_first begins") == log.count("function of test_first ends") == 5
    assert (log.count("late begins"), log.count("late ends")) == (2, 1)


def _options() -> list[str]:
    """Return the options with which ``make test`` runs tests again."""
    makefile = (ROOT / "Makefile").read_text()
    (options,) = re.findall(r"^SECOND_TRY := (.+)$", makefile, re.M)
    assert len(re.findall(r"-m pytest .*\$\(SECOND_TRY\)", makefile)) == 2, "of make test and make test-long"
    return options.split()
