"""The machine is paused for longer than every lease: no gateway was gone, so no robot holds."""

import signal
import time
from pathlib import Path

import pytest

from browser import LF
from commanding import PAN, begun, ended, moving, of_joint, put, slowly
from small_fleet import Place, live

pytestmark = pytest.mark.virtual
_PAUSE_S = 4.0  # Zenoh's leases of 2 and 2.5 s expire meanwhile


@pytest.mark.parametrize("whole", [False, True], ids=["the agent", "agent and gateway"])
def test_a_robot_goes_on_after_a_pause_and_its_motion_ends_well(tmp_path: Path, whole: bool) -> None:
    place = Place(tmp_path)
    with place.gateway() as (gateway, browser), place.ur5() as agent:
        live(browser, "ur5")
        motion = begun(put(browser, of_joint(browser, PAN), slowly(1.0, speed=0.2)))
        moving(browser, PAN)
        paused = [gateway, agent] if whole else [agent]
        for each in paused:
            each.send(signal.SIGSTOP)
        try:
            time.sleep(_PAUSE_S)
        finally:
            for each in paused:
                each.send(signal.SIGCONT)
        agent.said("the agent did not run for")
        assert ended(browser, motion).one(LF.state) == LF.succeeded
        assert "the robot holds" not in agent.output
