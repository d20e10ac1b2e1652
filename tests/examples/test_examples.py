"""The programs of examples/, run as their page says, against the demo as shipped."""

import base64
import json
import os
import re
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest
from mcap.reader import make_reader

from demonstration import Demo, running_demo
from driver_contract import check_driver
from linked_fleet_client.fleet import Fleet
from linked_fleet_client.vocabulary import LF, local_name
from running import PATIENCE_S, ROOT, eventually
from small_fleet import Place, live
from wot import HERE as NEIGHBOURS
from wot import node

pytestmark = [pytest.mark.processes, pytest.mark.test_all]

EXAMPLES = ROOT / "examples"
_MOST_LINES = 80
_LEADER, _FOLLOWER = "ur5/shoulder_pan_joint", "panda/panda_joint1"


@pytest.fixture(scope="module")
def demo(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Demo]:
    with running_demo(tmp_path_factory.mktemp("demo")) as demo:
        yield demo


def _angle(fleet: Fleet, joint: str) -> float:
    found = fleet.at(joint).properties["rotation"].value.number
    assert found is not None
    return found


def _elsewhere(began: float, angle: float) -> float | None:
    return angle if abs(angle - began) > 0.1 else None


class _Program:
    """An example that runs until it is interrupted."""

    def __init__(self, *command: str | Path, **environment: str) -> None:
        self.lines: list[str] = []
        self.process = subprocess.Popen(
            command, cwd=ROOT, env={**os.environ, **environment}, text=True,
            stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
        )  # fmt: skip
        self._reader = threading.Thread(target=self._read)
        self._reader.start()

    def _read(self) -> None:
        assert self.process.stdout is not None
        self.lines.extend(iter(self.process.stdout.readline, ""))

    def said(self, text: str) -> bool:
        assert self.process.poll() is None, self.lines
        return any(text in line for line in self.lines)

    def end(self, number: signal.Signals = signal.SIGINT) -> int:
        self.process.send_signal(number)
        code = self.process.wait(PATIENCE_S)
        self._reader.join()
        assert self.process.stdout is not None
        self.process.stdout.close()
        return code


def test_each_is_short_and_on_the_page() -> None:
    page = (EXAMPLES / "README.md").read_text()
    for path in sorted(EXAMPLES.iterdir()):
        if path.name != "README.md" and path.is_file():
            text = path.read_text()
            if path.suffix == ".ipynb":
                text = "".join("".join(cell["source"]) + "\n" for cell in json.loads(text)["cells"])
            assert len(text.splitlines()) < _MOST_LINES, path.name
            assert f"({path.name})" in page, path.name
    assert [name for name in re.findall(r"\]\(([\w.]+)\)", page) if not (EXAMPLES / name).exists()] == []


def test_the_notebook_plots_a_joint_and_asks_the_fleet(demo: Demo, tmp_path: Path) -> None:
    command = [Path(sys.executable).with_name("jupyter-execute"), EXAMPLES / "joint.ipynb"]
    done = subprocess.run(
        [*command, "--output", tmp_path / "run.ipynb"], check=False, capture_output=True, text=True,
        env={**os.environ, "LINKED_FLEET_URL": demo.root, "IPYTHONDIR": str(tmp_path)},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    cells = json.loads((tmp_path / "run.ipynb").read_text())["cells"]
    outputs = [output for cell in cells for output in cell.get("outputs", ())]
    assert any("image/png" in output.get("data", {}) for output in outputs)
    printed = "".join("".join(output["text"]) for output in outputs if output["output_type"] == "stream")
    assert len(re.findall(r"^\S.* \d+%$", printed, re.M)) == 5, printed


def test_the_follower_goes_where_the_leader_goes_and_holds_in_the_end(demo: Demo) -> None:
    with Fleet(demo.root) as fleet:
        program = _Program(sys.executable, EXAMPLES / "follow_the_leader.py", demo.root, _LEADER, _FOLLOWER)
        try:
            eventually(lambda: program.said("rad"), lambda: str(program.lines))
            began = _angle(fleet, _LEADER)
            eventually(lambda: _elsewhere(began, _angle(fleet, _LEADER)), "the leader sways")
            eventually(lambda: abs(_angle(fleet, _FOLLOWER) - _angle(fleet, _LEADER)) < 0.2, "they are close")
        finally:
            code = program.end()
    assert code == 0 and program.lines[-1] == "The follower holds.\n", program.lines


def test_the_flow_turns_one_robot_when_another_passes_an_angle(demo: Demo) -> None:
    with Fleet(demo.root) as fleet:
        began = _angle(fleet, _LEADER)
        angle = eventually(lambda: _elsewhere(began, _angle(fleet, _LEADER)), "the leader sways")
        flow = [node(), EXAMPLES / "flow.cjs", demo.root, f"{(began + angle) / 2:.4f}"]
        program = _Program(*flow, NODE_PATH=str(NEIGHBOURS / "node_modules"))
        try:
            eventually(lambda: program.said("passed at"), lambda: str(program.lines))
            assert not program.said("refused"), program.lines
            eventually(lambda: abs(abs(_angle(fleet, _FOLLOWER)) - 0.3) < 0.01, "the other has turned")
        finally:
            program.end(signal.SIGTERM)


def _ended(*command: str | Path) -> str:
    """Run an example to its end, and return what it has said."""
    done = subprocess.run(command, cwd=ROOT, check=False, capture_output=True, text=True, timeout=PATIENCE_S * 4)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def test_two_arms_pick_and_place_and_a_person_looks(demo: Demo) -> None:
    said = _ended(sys.executable, EXAMPLES / "two_arms.py", demo.root)
    for who in ("panda", "baxter"):
        assert f"succeeded  {who} grasps it" in said and f"succeeded  {who} lets go" in said
    assert "succeeded  Are the parts there?" in said
    with Fleet(demo.root) as fleet:
        assert [each.title for each in fleet.missions].count("Two arms pick and place") == 1


def test_a_patrol_has_a_picture_of_each_place_in_its_recording(demo: Demo, tmp_path: Path) -> None:
    path = tmp_path / "patrol.mcap"
    assert "succeeded: 3 pictures" in _ended(sys.executable, EXAMPLES / "patrol.py", demo.root, path)
    with path.open("rb") as file:
        messages = [json.loads(message.data) for _, _, message in make_reader(file).iter_messages()]
    assert [base64.b64decode(each["data"])[:2] for each in messages] == [b"\xff\xd8"] * 3
    assert len({each["data"] for each in messages}) == 3


def test_a_robot_charges_when_its_battery_falls_below_a_level(demo: Demo) -> None:
    """The level is the present one, below which the battery is within a minute."""
    with Fleet(demo.root) as fleet:
        battery = fleet.at("tiago/battery").properties["charge"]
        level = f"{battery.value.number:g}"
        _ended(sys.executable, EXAMPLES / "charge.py", demo.root, level, level)
        mission = fleet.missions.parts["tiago charges"]

        def states() -> list[str]:
            graph = fleet["missionRuns"].read().graph
            runs = graph.subjects(LF.mission, mission.iri)
            return [local_name(str(graph.value(each, LF.state))) for each in runs]

        for _ in fleet["missionRuns"].subscribe(timeout_s=PATIENCE_S * 4):
            if "succeeded" in states():
                break
        assert states() == ["succeeded"]


def test_a_robot_with_a_driver_of_its_own_joins_and_moves(tmp_path: Path) -> None:
    place = Place(tmp_path)
    with place.gateway() as (_, browser):
        program = _Program(sys.executable, EXAMPLES / "driver.py", "--connect", place.zenoh)
        try:
            live(browser, "head")
            with Fleet(place.root) as fleet:
                run = fleet["head"]["pan"].actions["rotate"](value=30, unit="deg")
                assert run.wait(PATIENCE_S) == "succeeded"
                assert _angle(fleet, "head/pan") == pytest.approx(0.5236, abs=0.01)
        finally:
            assert program.end(signal.SIGTERM) == 0, program.lines


def test_the_driver_keeps_the_contract(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(EXAMPLES))
    from driver import Head  # type: ignore[import-not-found]

    check_driver(Head())
