"""A client of another standard as a black box: node-wot finds a joint, reads it, observes it, and rotates it."""

from pathlib import Path

import pytest

from small_fleet import Place, live
from wot import HERE, printed

pytestmark = [pytest.mark.processes, pytest.mark.test_all]
RAD = "http://qudt.org/vocab/unit/RAD"


def test_node_wot_reads_observes_and_invokes(tmp_path: Path) -> None:
    place = Place(tmp_path)
    with place.gateway() as (_, browser), place.ur5():
        live(browser, "ur5")
        said = printed(HERE / "consume.cjs", place.root)
    assert said["thing"] == "shoulder_pan_joint of UR5, a six-axis arm"
    start, end, observed = said["read"], said["end"], said["observed"]
    assert start["unit"] == end["unit"] == RAD and end["value"] == pytest.approx(start["value"] + 0.2, abs=0.011)
    assert len(observed) > 3 and observed == sorted(observed), "each value on the way, in order"
    assert said["invoked"]["target"][0]["value"] == pytest.approx(start["value"] + 0.2, abs=1e-5)
