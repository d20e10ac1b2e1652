"""The demonstration of an agent: a stop ends it, and only a person restarts it."""

import signal
from pathlib import Path

import pytest

from browser import LF
from commanding import PAN, moving, post
from small_fleet import Place, live

pytestmark = pytest.mark.processes


def test_a_signal_restarts_stopped_demonstrations(tmp_path: Path) -> None:
    """The agent's log contains the command to copy."""
    place = Place(tmp_path)
    with place.gateway() as (_, browser), place.ur5("--sway", f"ur5:{PAN}") as agent:
        live(browser, "ur5")
        moving(browser, PAN)
        stop = browser.action(browser.page(browser.root), LF.StopAll)
        assert post(browser, stop, prefer="wait=30").status_code == 204
        agent.said(f"the demonstration of {PAN} has ended; to restart it: kill -USR1 ")
        agent.send(signal.SIGUSR1)
        agent.said(f"the demonstration of {PAN} restarts")
        moving(browser, PAN)
