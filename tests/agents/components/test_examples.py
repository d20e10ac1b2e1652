"""The examples with components, run by an agent as their users run them."""

import math
import sys
from pathlib import Path
from typing import Any

import pytest
from msgspec import Raw

from component_agent import Bench
from linked_fleet_agent.robots.of_components import RobotOfComponents
from linked_fleet_agent.wire.messages import Accepted, Reply

EXAMPLES = Path(__file__).parents[3] / "examples"


@pytest.fixture(autouse=True)
def _import_path(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "path", [str(EXAMPLES), *sys.path])


def is_accepted(reply: Reply) -> bool:
    return isinstance(reply, Accepted)


@pytest.mark.parametrize("example", ["gripper.py", "switch_box.py", "picker.py", "base.py"])
def test_they_have_at_most_60_lines(example: str) -> None:
    assert len((EXAMPLES / example).read_text().splitlines()) <= 60


async def test_the_gripper_holds_what_is_between_its_fingers_and_stops() -> None:
    from gripper import URDF, TwoFingers  # type: ignore[import-not-found]

    gripper = TwoFingers()
    bench = Bench(other=RobotOfComponents("Gripper", gripper, urdf=URDF, measure=lambda: [gripper.gap]))
    assert not is_accepted(bench.move("m", slide=0.02))  # its actions alone move its joint
    assert is_accepted(bench.operate("g", "grasp", {"force": 30}, component="gripper"))
    await bench.until(lambda: bench.states("g")[-1:] == ["succeeded"])
    assert bench.end("g").result == Raw(b'{"width":0.03,"holding":true,"force":30.0}')
    assert bench.end("g").feedback is not None
    await bench.until(lambda: bench.link.values[-1].components["gripper"].values.get("width") == Raw(b"0.03"))

    gripper.gap = 0.08
    assert is_accepted(bench.operate("h", "grasp", component="gripper"))
    await bench.until(lambda: gripper.gap < 0.08)
    assert is_accepted(bench.stop("s"))
    await bench.until(lambda: bench.states("h")[-1:] == ["cancelled"])
    assert gripper.gap > 0.03
    await bench.until(lambda: bench.states("s")[-1:] == ["succeeded"])


async def test_the_switch_box_reads_and_sets_lines(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    import switch_box  # type: ignore[import-not-found]

    monkeypatch.setattr(switch_box, "GPIO", tmp_path)
    for line in (*switch_box.INPUTS, *switch_box.OUTPUTS):
        (tmp_path / f"gpio{line}").mkdir()
        (tmp_path / f"gpio{line}" / "value").write_text("0")
    bench = Bench(other=switch_box.switch_box())

    def last(component: str) -> Any:
        channel = "input" if component.startswith("input") else "output"
        said = [
            each.components[component].values.get(channel) for each in bench.link.values if component in each.components
        ]
        return next((each for each in reversed(said) if each is not None), None)

    await bench.until(lambda: last("input1") == Raw(b"false") and last("output4") == Raw(b"false"))
    (tmp_path / "gpio17" / "value").write_text("1")
    await bench.until(lambda: last("input1") == Raw(b"true"))
    await bench.until(
        lambda: [(each.component, each.event) for each in bench.link.events] == [("input1", "switchedOn")]
    )
    assert is_accepted(bench.operate("o", "", True, property="output", component="output1"))
    await bench.until(lambda: last("output1") == Raw(b"true"))
    assert (tmp_path / "gpio5" / "value").read_text() == "1"
    assert not is_accepted(bench.operate("i", "", True, property="input", component="input1"))
    (tmp_path / "gpio27" / "value").unlink()
    await bench.until(lambda: "input2" in bench.link.values[-1].components and last("input2") == Raw(b"null"))


async def test_the_cell_picks_rehearses_and_ends_early(monkeypatch: pytest.MonkeyPatch) -> None:
    import picker  # type: ignore[import-not-found]

    monkeypatch.setattr(picker, "PICK_S", 0.01)
    bench = Bench(other=RobotOfComponents("Picking cell", picker.Cell()))
    rehearsed = bench.operate("r", "pick", {"count": 5}, component="cell", rehearsal=True)
    assert isinstance(rehearsed, Accepted)
    assert rehearsed.duration_s == pytest.approx(0.15)
    assert is_accepted(bench.operate("p", "pick", {"count": 3}, component="cell"))
    await bench.until(lambda: bench.states("p")[-1:] == ["succeeded"])
    assert bench.end("p").result == Raw(b'{"parts":3,"mass":0.6000000000000001}')
    monkeypatch.setattr(picker, "PICK_S", 30)
    assert is_accepted(bench.operate("q", "pick", {"count": 20}, component="cell"))
    await bench.until(lambda: bench.states("q") == ["running"])
    assert is_accepted(bench.stop("s"))
    await bench.until(lambda: bench.states("q")[-1:] == ["cancelled"])


async def test_the_base_drives_an_arc_by_its_two_motors() -> None:
    from base import URDF, Cart  # type: ignore[import-not-found]

    cart = Cart()
    cell = RobotOfComponents("Cart", cart, urdf=URDF, measure=lambda: cart.angles, measure_base=lambda: cart.reading)
    bench = Bench(other=cell)
    given = {"linear": 0.5, "angular": 1.0, "duration": 1}
    assert is_accepted(bench.operate("d", "drive", given, component="mobile_base"))
    await bench.until(lambda: bench.states("d")[-1:] == ["succeeded"])
    assert bench.states("d") == ["running", "succeeded"]
    # 0.5 m/s for 1 s, less the acceleration and more the braking, which take as long; the radius is 0.5 m.
    assert cart.odometry.heading == pytest.approx(1.0, abs=0.03)
    x, y = cart.odometry[:2]
    assert math.hypot(x, y - 0.5) == pytest.approx(0.5, abs=0.01)
    state = bench.link.states[-1]
    assert state.base is not None
    assert state.base.position_m == pytest.approx((x, y, 0.0), abs=1e-3)
    left, right = state.positions
    assert (right - left) * 0.08 / 0.4 == pytest.approx(cart.odometry.heading, abs=1e-3)
