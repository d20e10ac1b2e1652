"""The two wheels, installed beside packages with common names and used outside the checkout."""

import json
import subprocess
import zipfile
from pathlib import Path

import pytest

from installed import build_wheels, environment, running
from linked_fleet_demo.tree import ROBOTS
from running import ROOT, eventually, free_port

pytestmark = [pytest.mark.processes, pytest.mark.test_all]


@pytest.fixture(scope="module")
def wheels(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    return build_wheels(tmp_path_factory.mktemp("wheels"), ROOT)


@pytest.fixture(scope="module")
def installed(wheels: list[Path], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Create an environment with the project's wheels and openai-agents; it borrows their dependencies."""
    return environment(tmp_path_factory.mktemp("environment"), wheels, "openai-agents")


def _modules(wheel: Path) -> set[str]:
    with zipfile.ZipFile(wheel) as archive:
        return {name.partition("/")[0] for name in archive.namelist() if ".dist-info/" not in name}


def test_wheels_install_modules_of_our_name_alone(wheels: list[Path]) -> None:
    gateway, agent = wheels
    assert _modules(agent) == {"linked_fleet_agent"}
    assert _modules(gateway) == {
        "linked_fleet_base", "linked_fleet_client", "linked_fleet_demo", "linked_fleet_doctor", "linked_fleet_gateway",
        "linked_fleet_identity", "linked_fleet_link", "linked_fleet_rdf", "linked_fleet_runtime", "linked_fleet_server",
        "linked_fleet_shacl", "linked_fleet_shapes", "linked_fleet_state", "linked_fleet_valkey",
        "linked_fleet_webhooks",
    }  # fmt: skip


def test_the_wheel_of_the_agent_needs_two_packages(wheels: list[Path]) -> None:
    with zipfile.ZipFile(wheels[1]) as archive:
        (name,) = (each for each in archive.namelist() if each.endswith(".dist-info/METADATA"))
        lines = archive.read(name).decode().splitlines()
    needed = [line for line in lines if line.startswith("Requires-Dist:") and "extra ==" not in line]
    assert [line.split()[1].partition(">")[0] for line in needed] == ["eclipse-zenoh", "msgspec"]


def test_no_module_of_another_package_is_taken_or_shadowed(installed: Path) -> None:
    code = (
        "import importlib.util, json; "
        "print(json.dumps({name: getattr(importlib.util.find_spec(name), 'origin', None) for name in "
        "('agents', 'gateway', 'client', 'demo', 'shapes', 'telemetry', 'linked_fleet_gateway')}))"
    )
    said = subprocess.run(
        [installed / "python", "-c", code], check=True, capture_output=True, text=True, cwd="/"
    ).stdout
    found = json.loads(said)
    inside = str(installed.parent)
    assert found.pop("agents").startswith(inside), "that of openai-agents"
    assert found.pop("linked_fleet_gateway").startswith(inside), "ours, and not that of the checkout"
    assert set(found.values()) == {None}


def _seen(installed: Path, root: str) -> set[str]:
    """Return the robots that the client lists; none while there is no gateway."""
    done = subprocess.run(
        [installed / "linked-fleet", "--url", root, "--json", "ls"],
        capture_output=True,
        text=True,
        cwd="/",
        check=False,
    )
    return {name for name in ROBOTS if f"/{name}" in done.stdout}


def test_gateway_agent_and_client_run_from_the_wheels(installed: Path, tmp_path: Path) -> None:
    port, zenoh = free_port(), f"tcp/127.0.0.1:{free_port()}"
    root = f"http://127.0.0.1:{port}/"
    gateway = ("gateway", "--port", str(port), "--zenoh-listen", zenoh)
    agent = ("--robot", "ur5", "--connect", zenoh)
    with (
        running(installed, "linked-fleet", *gateway, cwd=tmp_path),
        running(installed, "linked-fleet-agent", *agent, cwd=tmp_path),
    ):
        eventually(lambda: _seen(installed, root) == {"ur5"}, "a robot that the client sees")


def test_the_demo_runs_from_the_wheels(installed: Path, tmp_path: Path) -> None:
    port = free_port()
    with running(installed, "linked-fleet", "demo", "--port", str(port), cwd=tmp_path):
        eventually(lambda: len(_seen(installed, f"http://127.0.0.1:{port}/")) == len(ROBOTS), "six robots")
