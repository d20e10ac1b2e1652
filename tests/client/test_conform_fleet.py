"""The conformance checker on the real fleet, as a command."""

import json
from pathlib import Path

import pytest
import rdflib
from browser import HYBRIT, LDP, Browser
from conftest import RunningFleet
from rdflib import RDF

from client.conform import command

EARL = rdflib.Namespace("http://www.w3.org/ns/earl#")
pytestmark = pytest.mark.fleet


def _subscriptions(browser: Browser) -> set[object]:
    found: set[object] = set()
    for page in [browser.page(browser.root), *browser.robots()]:
        found.update(browser.page(str(page.one(HYBRIT.subscriptions))).graph.objects(None, LDP.contains))
    return found


def test_fleet_breaks_no_must(
    fleet: RunningFleet, browser: Browser, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """All musts that can be told are passed, the EARL says the same as the JSON, and no subscription is left behind."""
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
