"""An agent, or the whole machine, is paused while its robot moves."""

import signal
import time
from pathlib import Path

import pytest

from browser import LF
from commanding import PAN, angle, begun, ended, moving, of_joint, put, reason, slowly
from small_fleet import Place, live

pytestmark = pytest.mark.virtual
_SHORT_S, _LONG_S = 2.2, 4.0  # the lease is 2.5 s; connections of Zenoh are lost in both


@pytest.mark.parametrize("whole", [False, True], ids=["the agent", "agent and gateway"])
@pytest.mark.parametrize("pause_s", [_SHORT_S, _LONG_S])
def test_a_robot_goes_on_after_a_pause_shorter_than_the_lease_and_else_holds(
    tmp_path: Path, whole: bool, pause_s: float
) -> None:
    """No motion goes on after an agent did not run for longer than the lease; a new one does."""
    place = Place(tmp_path)
    with place.gateway() as (gateway, browser), place.ur5() as agent:
        live(browser, "ur5")
        action = of_joint(browser, PAN)
        motion = begun(put(browser, action, slowly(1.0, speed=0.2)))
        moving(browser, PAN)
        paused = [gateway, agent] if whole else [agent]
        for each in paused:
            each.send(signal.SIGSTOP)
        try:
            time.sleep(pause_s)
        finally:
            for each in paused:
                each.send(signal.SIGCONT)
        page = ended(browser, motion)
        if pause_s < _LONG_S:
            assert page.one(LF.state) == LF.succeeded
            assert "the robot holds" not in agent.output
            return
        assert page.one(LF.state) == LF.failed
        assert "the agent did not run for" in reason(page)
        live(browser, "ur5")
        held = angle(browser, PAN)
        time.sleep(5.0)
        assert angle(browser, PAN) == pytest.approx(held, abs=1e-3)  # it settles at its setpoint
        assert held < 0.9
        assert put(browser, action, slowly(1.0, speed=0.8), prefer="wait=30").status_code == 204
        assert angle(browser, PAN) == pytest.approx(1.0, abs=0.01)
