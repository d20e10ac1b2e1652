"""The event loop of a gateway hangs while Zenoh's threads continue: robots consider it gone meanwhile."""

import contextlib
import signal
from pathlib import Path

import pytest

from browser import LF, Browser
from commanding import PAN, angle, begun, ended, moving, of_joint, put, radian, reason, slowly
from hanging_gateway import GOES_ON, HANGS
from running import eventually, process
from small_fleet import Place, live

pytestmark = pytest.mark.processes


@pytest.mark.parametrize("how", [signal.SIGUSR1, signal.SIGUSR2], ids=["time.sleep", "C code with the GIL"])
def test_robots_hold_while_the_event_loop_of_their_gateway_hangs(tmp_path: Path, how: signal.Signals) -> None:
    """The motion fails long before the hang ends; afterwards the robot accepts commands again."""
    place = Place(tmp_path)
    with (
        process("tests/support/hanging_gateway.py", *place.command()[2:]) as gateway,
        contextlib.closing(Browser(place.root)) as browser,
        place.ur5() as agent,
    ):
        gateway.said("serving")
        live(browser, "ur5")
        motion = begun(put(browser, of_joint(browser, PAN), slowly(3.0, speed=0.1)))
        moving(browser, PAN)
        gateway.send(how)
        gateway.said(HANGS)
        try:
            agent.said("the last gateway is gone; the robot holds")
        finally:
            gateway.send(signal.SIGALRM)
        gateway.said(GOES_ON)
        agent.said("a gateway is back")
        page = ended(browser, motion)
        assert (page.one(LF.state), reason(page)) == (LF.failed, "gateway lost")
        assert angle(browser, PAN) < 2.0
        eventually(lambda: _moves(browser), "a motion")
        assert "Traceback" not in gateway.output + agent.output


def _moves(browser: Browser) -> bool:
    """Return True if it accepts a motion. Right after a hang the gateway may lack new frames of the robot."""
    answer = put(browser, of_joint(browser, PAN), radian(0.2), prefer="wait=30")
    return answer.status_code == 204 and browser.page(begun(answer)).one(LF.state) == LF.succeeded
