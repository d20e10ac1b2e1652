"""Agents of wire 1 with a gateway of this release, and agents of this release with a gateway of wire 1.

The packages of wire 1 are wheels of the last commit before components, installed in an environment of their own.
"""

import contextlib
import io
import json
import subprocess
import sys
import tarfile
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import httpx
import pytest
import zenoh

from browser import DCTERMS, LF, ROS, SPATIAL, Browser
from fake_robots import open_session
from installed import build_wheels, environment, running
from linked_fleet_agent.wire.keys import Keys
from running import ROOT, eventually, free_port, process
from small_fleet import Place, live, number, property_page

pytestmark = [pytest.mark.processes, pytest.mark.test_all]

LAST_OF_WIRE_1 = "a5e4737bede864ef77826f8faa630fd30adb6f72"
_MALFORMED = "linked_fleet_messages_malformed_total"


@pytest.fixture(scope="module")
def wire_1(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the programs of wire 1. Nothing is fetched: build tools and dependencies are those of the tests."""
    folder = tmp_path_factory.mktemp("wire-1")
    archive = subprocess.run(["git", "archive", LAST_OF_WIRE_1], cwd=ROOT, capture_output=True, check=False)
    if archive.returncode:
        pytest.skip(
            f"git has no commit {LAST_OF_WIRE_1}, the last one of wire 1, which a clone with its history has "
            f"(git fetch --unshallow): {archive.stderr.decode().strip()}"
        )
    with tarfile.open(fileobj=io.BytesIO(archive.stdout)) as tree:
        tree.extractall(folder / "tree", filter="data")
    wheels = build_wheels(folder / "wheels", folder / "tree", "--no-index", "--no-build-isolation")
    return environment(folder / "environment", wheels)


def _turn(root: str, path: str, degrees: float) -> dict[str, object]:
    """Turn a joint by the command line, and return how that ended."""
    command = [sys.executable, "-m", "linked_fleet_client.cli.main", "--url", root, "--json", "do", path, "rotate"]
    done = subprocess.run(
        [*command, f"value={degrees}", "unit=deg"], cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert done.stdout, done.stderr
    ended: dict[str, object] = json.loads(done.stdout)
    return ended


def _angle(browser: Browser, robot: str, joint: str) -> object:
    return number(property_page(browser, robot, joint, ROS.rotation), SPATIAL.rotationAngle)


def _malformed(root: str) -> list[str]:
    lines = httpx.get(f"{root}metrics").text.splitlines()
    return [line.split()[1] for line in lines if line.startswith(_MALFORMED)]


def test_the_older_packages_speak_wire_1(wire_1: Path) -> None:
    code = "from linked_fleet_agent.wire import messages; print(vars(messages).get('COMPONENTS_VERSION'))"
    said = subprocess.run([wire_1 / "python", "-c", code], cwd="/", capture_output=True, text=True, check=True).stdout
    assert said == "None\n"


def test_an_agent_of_wire_1_works_with_this_gateway(wire_1: Path, tmp_path: Path) -> None:
    place = Place(tmp_path / "state")
    agent = ("--robot", "ur5", "--connect", place.zenoh)
    with place.gateway() as (gateway, browser), running(wire_1, "linked-fleet-agent", *agent, cwd=tmp_path):
        live(browser, "ur5")
        assert _turn(place.root, "ur5/shoulder_pan_joint", 5.0)["state"] == "succeeded"
        assert _angle(browser, "ur5", "shoulder_pan_joint") == pytest.approx(0.0872665, abs=1e-3)
        assert _malformed(place.root) == ["0.0"], gateway.output


def test_a_gateway_of_wire_1_ignores_the_components_of_this_agent(wire_1: Path, tmp_path: Path) -> None:
    port, router, log = free_port(), f"tcp/127.0.0.1:{free_port()}", tmp_path / "linked-fleet.log"
    root, gateway = f"http://127.0.0.1:{port}/", ("gateway", "--port", str(port), "--zenoh-connect", router)
    with (
        process("tests/support/zenoh_router.py", router),
        running(wire_1, "linked-fleet", *gateway, cwd=tmp_path),
        process("tests/support/counting_robot.py", "--connect", router),
        open_session(router) as session,
        contextlib.closing(Browser(root)) as browser,
        _heard(session) as heard,
    ):
        eventually(lambda: "serving" in log.read_text(), log.read_text)
        page = live(browser, "r")
        parts = {str(page.graph.value(part, DCTERMS.title)) for part in page.graph.objects(page.iri, DCTERMS.hasPart)}
        assert parts == {"arm", "finger", "base", "a", "b"}
        before = heard.copy()
        assert _turn(root, "r/arm", 5.0)["state"] == "succeeded"
        assert _angle(browser, "r", "arm") == pytest.approx(0.0872665, abs=1e-3)
        assert heard["values"] > before["values"], "the motion took place among values"
        assert heard["event"] > before["event"]
        assert live(browser, "r").one(LF.presence) == LF.online
        assert _malformed(root) == ["0.0"], log.read_text()
        assert "robot r" not in "".join(line for line in log.read_text().splitlines() if "WARNING" in line)


@contextlib.contextmanager
def _heard(session: zenoh.Session) -> Iterator[Counter[str]]:
    """Count messages of components, as a gateway of this release hears them."""
    heard = Counter[str]()
    kept = [
        session.declare_subscriber(Keys().all_of_kind(kind), lambda said, kind=kind: heard.update([kind]))
        for kind in ("values", "event")
    ]
    yield heard
    for each in kept:
        each.undeclare()
