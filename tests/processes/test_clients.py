"""Clients as processes: the command line, the conformance checker, examples/frames.py."""

import contextlib
import json
import math
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
import rdflib
from rdflib import RDF

from browser import HYBRIT, LDP, LF, Browser
from linked_fleet_client.conform import command
from running import ROOT, process
from small_fleet import Place, live
from subscribers import ObservedFleet

CLIENT = ROOT / "examples" / "frames.py"
pytestmark = [pytest.mark.processes, pytest.mark.test_all]
EARL = rdflib.Namespace("http://www.w3.org/ns/earl#")


@pytest.fixture(scope="module")
def fleet(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Place]:
    place = Place(tmp_path_factory.mktemp("clients"))
    with place.gateway() as (_, browser), place.ur5("--robot=baxter"):
        live(browser, "ur5")
        live(browser, "baxter")
        yield place


@pytest.fixture(scope="module")
def browser(fleet: Place) -> Iterator[Browser]:
    with contextlib.closing(Browser(fleet.root)) as browser:
        yield browser


@pytest.fixture(scope="module")
def scene(fleet: Place, browser: Browser) -> ObservedFleet:
    return ObservedFleet(fleet, browser)


def test_the_command_line_looks_and_moves(fleet: Place) -> None:
    def said(*arguments: str) -> str:
        command = [sys.executable, "-m", "linked_fleet_client.cli.main", "--url", fleet.root, *arguments]
        return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=120, check=True).stdout

    assert ["baxter", "Robot", "online"] in [line.split() for line in said("ls").splitlines()]
    done = json.loads(said("do", "ur5/shoulder_pan_joint", "rotate", "value=5", "unit=deg", "--json"))
    assert done["state"] == "succeeded"
    assert "succeeded" in said("stop", "ur5")
    rehearsed = said("do", "ur5/shoulder_pan_joint", "rotate", "value=9", "--dry-run", "unit=deg", "--json")
    assert json.loads(rehearsed)["dryRun"]
    watched = said("watch", "ur5/shoulder_pan_joint/rotation", "--count", "1", "--json", "--unit", "deg")
    ((values,),) = [list(json.loads(watched)["values"].values())[:1]]
    assert math.isclose(values["number"], 5, abs_tol=0.5)


def _subscriptions(browser: Browser) -> set[object]:
    found: set[object] = set()
    for page in [browser.page(browser.root), *browser.robots()]:
        found.update(browser.page(str(page.one(HYBRIT.subscriptions))).graph.objects(None, LDP.contains))
    return found


def test_fleet_breaks_no_must(
    fleet: Place, browser: Browser, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """All checkable musts pass, EARL and JSON agree, and no subscription is left behind."""
    before = _subscriptions(browser)
    assert command([fleet.root, "--json", "--earl", str(tmp_path / "earl.ttl"), "--resources", "80"]) == 0
    report = json.loads(capsys.readouterr().out)
    outcomes = {result["id"]: result["outcome"] for result in report["results"]}
    assert len(outcomes) == 29
    musts = {result["id"] for result in report["results"] if result["level"] == "must"}
    assert {name: outcomes[name] for name in musts if outcomes[name] != "passed"} == {
        "R1.1": "cantTell",
        "R1.4": "inapplicable",
    }
    assert {outcomes["R0.13"], outcomes["R0.17"], outcomes["R1.9"], outcomes["R1.10"], outcomes["R1.11"]} == {"passed"}
    assert _subscriptions(browser) <= before
    _same(rdflib.Graph().parse(tmp_path / "earl.ttl"), outcomes, fleet.root)


def _same(earl: rdflib.Graph, outcomes: dict[str, str], root: str) -> None:
    asserted = {}
    for assertion in earl.subjects(RDF.type, EARL.Assertion):
        test, result = earl.value(assertion, EARL.test), earl.value(assertion, EARL.result)
        assert earl.value(assertion, EARL.subject) == rdflib.URIRef(root)
        assert earl.value(assertion, EARL.assertedBy)
        assert earl.value(result, EARL.info)
        assert earl.value(result, rdflib.DCTERMS.date)
        asserted[str(test).rpartition("#")[2]] = str(earl.value(result, EARL.outcome)).rpartition("#")[2]
    assert asserted == outcomes


def test_the_example_reads_the_frames_of_a_joint_state(scene: ObservedFleet) -> None:
    """Two frames of a whole robot, printed by a client that only has rdflib, websockets and the link."""
    with scene.toy(0.25, -0.5) as toy:
        state, elbow = str(toy.page.one(LF.jointState)), toy.rotation()
        with process("-I", str(CLIENT), state, "2") as run:
            run.said(f"elbow/rotation 0.25 http://qudt.org/vocab/unit/RAD {elbow}\n")
            toy.pose(0.5, -0.125)
            assert run.ended() == 0
        assert f"elbow/rotation 0.5 http://qudt.org/vocab/unit/RAD {elbow}\n" in run.output
        assert "shoulder/rotation -0.125 " in run.output
        assert "elbow/effort nan http://qudt.org/vocab/unit/N-M " in run.output


def test_the_example_reads_the_frames_of_one_property(scene: ObservedFleet) -> None:
    """The same client, unchanged, on a single value."""
    with scene.toy(0.25) as toy:
        with process("-I", str(CLIENT), toy.rotation(), "2") as run:
            run.said(f"rotation 0.25 http://qudt.org/vocab/unit/RAD {toy.rotation()}\n")
            toy.pose(0.75)
            assert run.ended() == 0
        assert "rotation 0.75 " in run.output
