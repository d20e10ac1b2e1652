"""The three missions of examples/ on the demo as shipped: their program and the gateway are killed, and they go on."""

import contextlib
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import httpx
import pytest
from playwright.sync_api import Page, expect
from rdflib import Literal

from browser import DCTERMS, LF, Browser
from demonstration import Demo, running_demo
from running import PATIENCE_S, ROOT, eventually

pytestmark = [pytest.mark.processes, pytest.mark.test_all]
_LONG_MS = 4 * PATIENCE_S * 1000


@pytest.fixture(scope="module")
def demo(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Demo]:
    with running_demo(tmp_path_factory.mktemp("demo")) as demo:
        yield demo


def _charge(root: str) -> str:
    """Return a level that the battery of TIAGo is below within a minute."""
    answer = httpx.get(f"{root}tiago/battery/charge", headers={"accept": "application/json"})
    return f"{answer.json()['value']:g}"


def _runs(demo: Demo) -> set[str]:
    with contextlib.closing(Browser(demo.root)) as browser:
        return {str(run) for run in browser.page(demo.root + "mission-runs").graph.subjects(LF.mission)}


@pytest.mark.parametrize(
    ("example", "step", "decision"),
    [
        ("two_arms.py", "carries it to its place", "Yes: Are both parts in their places?"),
        ("patrol.py", "drive to the corner", "Retry: drive to the corner"),
        ("charge.py", "charge", ""),
    ],
)
def test_a_mission_goes_on_in_the_browser_after_its_program_and_the_gateway_were_killed(
    page: Page, demo: Demo, tmp_path: Path, example: str, step: str, decision: str
) -> None:
    """A gateway drives a base, so nobody knows how a drive has ended whose gateway is gone: a person decides."""
    before = _runs(demo)
    level = [_charge(demo.root)] * 2 if example == "charge.py" else []
    more = [tmp_path / "patrol.mcap"] if example == "patrol.py" else level
    with subprocess.Popen([sys.executable, ROOT / "examples" / example, demo.root, *more]) as program:
        if example == "charge.py":  # which ends by itself, and lets a rule run its mission some time
            assert program.wait(PATIENCE_S) == 0
            _run(demo, "tiago charges")
        (run,) = eventually(lambda: _runs(demo) - before, "a run of the mission")
        program.kill()
    page.goto(run)
    state = page.locator(".run-steps li", has_text=step).locator(
        ".state:is([data-state=running], [data-state=waiting])"
    )
    expect(state.first).to_be_visible(timeout=_LONG_MS)
    os.kill(demo.gateway(), signal.SIGKILL)
    if decision:
        button = page.get_by_role("button", name=decision).first
        expect(button).to_be_visible(timeout=_LONG_MS)
        button.click()
    expect(page.locator("#run-state .state")).to_have_attribute("data-state", "succeeded", timeout=_LONG_MS)
    expect(page.locator('.run-steps .state:not([data-state="succeeded"])')).to_have_count(0)


def _run(demo: Demo, title: str) -> None:
    with contextlib.closing(Browser(demo.root)) as browser:
        listed = browser.page(demo.root + "missions").graph
        mission = next(str(each) for each in listed.subjects(DCTERMS.title, Literal(title)))
        assert browser.http.post(f"{mission}/actions/run").is_success
