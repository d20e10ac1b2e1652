"""The agent and the gateway work with the lowest versions of their dependencies that they declare."""

import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

pytestmark = pytest.mark.test_all
ROOT = Path(__file__).parents[2]
EXTRAS = ("mcp", "foxglove", "sim", "ros", "tracing")
_BOUND = re.compile(r"([A-Za-z0-9_.-]+)(?:\[[a-z,]+\])?>=([0-9.]+)")
# Their versions are those of a dependency whose lowest version is installed.
_FOLLOWING = re.compile(r"opentelemetry|mujoco|protobuf|cmeel|coal|eigenpy|lib")
_OTHERWISE = ("PIP_CONSTRAINT", "PIP_BUILD_CONSTRAINT", "PYTEST_")
"""Variables of this run that do not apply to the other environment."""
TESTS = (
    "tests/agents", "tests/gateway/app", "tests/gateway/http", "tests/gateway/subscriptions", "tests/identity",
    "tests/link", "tests/rdf", "tests/runtime", "tests/state", "gateway/linked_fleet_gateway/extensions/query",
)  # fmt: skip
"""The others use no dependency that these do not."""
LONG = ("tests/agents/test_simulated_paths.py", "tests/agents/test_walking.py")
"""Minutes of simulation, which use no more of a dependency than the others."""


def _declared() -> dict[str, str]:
    """Return the lowest declared version of each dependency, by its name."""
    found = dict[str, str]()
    for file in ("pyproject.toml", "agents/pyproject.toml"):
        project = tomllib.loads((ROOT / file).read_text())["project"]
        optional = project.get("optional-dependencies", {})
        for each in (*project["dependencies"], *(each for extra in EXTRAS for each in optional.get(extra, ()))):
            if (bound := _BOUND.fullmatch(each)) is not None:
                found[bound[1].lower()] = bound[2]
    return found


def _constraints() -> str:
    """Return the lowest versions, and for tools of the tests those of the usual environment."""
    lowest = _declared()
    pinned = [line for line in (ROOT / "deploy/constraints.txt").read_text().splitlines() if "==" in line]
    others = [line for line in pinned if line.partition("==")[0].lower() not in lowest and not _FOLLOWING.match(line)]
    return "\n".join([*(f"{name}=={version}" for name, version in lowest.items()), *others, ""])


def test_every_dependency_has_a_lowest_version() -> None:
    names = _declared()
    assert {"msgspec", "mujoco", "uvicorn", "rdflib", "eclipse-zenoh", "redis"} <= names.keys()


def test_the_tests_pass_with_the_lowest_versions(tmp_path: Path) -> None:
    """A bound that is too low would be found by a user, whose environment has an older version for another reason."""
    (tmp_path / "constraints.txt").write_text(_constraints())
    environment = {name: value for name, value in os.environ.items() if not name.startswith(_OTHERWISE)}
    subprocess.run([sys.executable, "-m", "venv", tmp_path / "venv"], check=True)
    python = str(tmp_path / "venv/bin/python")
    tools = (
        "pytest",
        "pytest-xdist",
        "pytest-rerunfailures",
        "pytest-timeout",
        "hypothesis",
        "fakeredis[lua]",
        "jsonschema",
        "playwright",
    )
    more = ("playwright", "pyyaml", "schemathesis", "nbclient", "mcap-ros2-support", "import-linter")
    install = ["-m", "pip", "install", "-q", "-c", str(tmp_path / "constraints.txt")]
    packages = ["-e", "agents[sim,ros,tracing]", "-e", ".[mcp,foxglove]", *tools, *more]
    subprocess.run([python, *install, *packages], check=True, cwd=ROOT, env=environment)
    chosen = ["-q", "-n", "2", "--dist", "loadfile", "-m", "not test_all and not hypothesis", "-p", "no:cacheprovider"]
    chosen += [f"--ignore={each}" for each in LONG]
    done = subprocess.run(
        [python, "-m", "pytest", *chosen, *TESTS], cwd=ROOT, env=environment, capture_output=True, text=True
    )
    assert done.returncode == 0, "\n".join(
        line for line in done.stdout.splitlines() if line.startswith(("FAILED", "ERROR", "E  "))
    )
