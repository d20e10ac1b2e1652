"""Missions by the client and by the command line."""

import io
import json
import os
from collections.abc import Iterator
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path
from typing import Any
from unittest.mock import patch

import pytest
from rdflib import Graph

from linked_fleet_client.cli.main import main
from linked_fleet_client.cli.mission_tree import tree_lines
from linked_fleet_client.errors import InvalidInput, NoSuchThing, Problem
from linked_fleet_client.fleet import Fleet
from linked_fleet_client.mission import Mission, RunState, StepState
from shared_fixtures import RunningFleet

pytestmark = pytest.mark.virtual
ROBOTS = ("ur5",)
RAD = "http://qudt.org/vocab/unit/RAD"


@pytest.fixture
def here(fleet: RunningFleet) -> Iterator[Fleet]:
    with Fleet(fleet.root) as here:
        yield here
        for each in here.missions:
            here.missions.remove(each)


def nod(here: Fleet, *more: dict[str, Any], **members: Any) -> dict[str, Any]:
    action = f"{here.iri}ur5/wrist_3_joint/actions/rotate"
    turn = {"type": "invoke", "name": "turn", "action": action, "body": {"value": {"variable": "angle"}, "unit": RAD}}
    angle = {"name": "angle", "type": "number", "minimum": -0.5, "maximum": 0.5, "default": 0.1}
    return {"title": "Nod", "parameters": [angle], "step": {"type": "sequence", "steps": [turn, *more]}, **members}


def test_missions_are_added_found_replaced_and_removed(here: Fleet) -> None:
    added = here.missions.add(nod(here))
    assert isinstance(here.missions.parts["Nod"], Mission) and here["missions"]["Nod"].iri == added.iri
    assert added.definition()["step"]["steps"][0]["name"] == "turn"
    changed = nod(here, {"type": "notify", "text": "done"})
    assert here.missions.write(changed).iri == added.iri
    assert added.definition()["step"]["steps"][1]["text"] == "done"
    with patch.object(here.web, "send", wraps=here.web.send) as sent:
        here.missions.write(changed)
    assert {call.args[0] for call in sent.call_args_list} == {"GET"}, "it is not written again"
    here.missions.remove("Nod")
    assert list(here.missions) == []


def test_a_mission_is_checked_and_not_added(here: Fleet) -> None:
    here.missions.check(nod(here))
    with pytest.raises(Problem, match="fly"):
        here.missions.check(nod(here, {"type": "invoke", "action": f"{here.iri}ur5/actions/fly"}))
    assert list(here.missions) == []


def test_a_mission_in_turtle_is_the_same(here: Fleet) -> None:
    added = here.missions.add(nod(here))
    graph = Graph().parse(data=here.web.send("GET", str(added.iri), None, {"accept": "text/turtle"}).body)
    about = [triple for triple in graph if triple[2] != added.iri]
    said = Graph()
    for subject, predicate, value in about:
        said.add((subject, predicate, value))
    assert here.missions.write(said).iri == added.iri


def test_a_run_has_its_steps_and_its_end(here: Fleet) -> None:
    mission = here.missions.add(nod(here, {"type": "notify", "text": "done"}))
    with pytest.raises(InvalidInput, match="angle"):
        mission.run(angle=3)
    assert mission.rehearse(angle=0.2) is not None
    run = mission.run(angle=0.2)
    seen = [each.state for each in run.watch()]
    assert seen[-1] == "succeeded" and run.wait() == "succeeded"
    assert [(each.path, each.title, each.kind, each.state) for each in run.steps] == [
        ("0.0", "turn", "InvokeStep", "succeeded"), ("0.1", "", "NotifyStep", "succeeded"),
    ]  # fmt: skip
    assert run.now.notes == ("done",) and run.steps[0].invocation.startswith(str(here.iri))


def test_a_run_is_paused_resumed_answered_and_cancelled(here: Fleet) -> None:
    ask = {"type": "confirm", "name": "ask", "text": "go?"}
    run = here.missions.add(nod(here, ask, {"type": "confirm", "text": "on?"})).run()
    for state in run.watch():
        if state.in_state("waiting"):
            break
    run.pause()
    assert run.now.state == "paused"
    with pytest.raises(Problem, match="paused"):
        run.pause()
    run.resume()
    with pytest.raises(NoSuchThing, match="jump"):
        run.skip("jump")
    run.confirm("ask")
    for state in run.watch():
        if [each.path for each in state.in_state("waiting")] == ["0.2"]:
            break
    run.cancel()
    assert run.wait() == "cancelled"
    with pytest.raises(NoSuchThing, match="none"):
        run.confirm()


def test_a_step_that_failed_is_skipped(here: Fleet) -> None:
    no = {"type": "wait", "name": "never", "condition": "SELECT ?a WHERE { ?a <urn:x> ?b }", "within": 1}
    run = here.missions.add(nod(here, no, holds=True)).run()
    for state in run.watch():
        if state.state == "blocked":
            break
    run.retry("never")
    for state in run.watch():
        if state.state == "blocked" and state.in_state("failed")[0].attempt == 2:
            break
    run.skip("never")
    assert run.wait() == "succeeded"


# -- the command line -------------------------------------------------------------------------------------------------


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def command(here: Fleet, *arguments: str, out: io.StringIO | None = None) -> tuple[int, str, str]:
    out, err = out or io.StringIO(), io.StringIO()
    # On virtual time there are no threads; test_cli.py has those.
    at_once = patch("linked_fleet_client.cli.invoke._in_thread", lambda wait, name: wait())
    with patch.dict(os.environ, LINKED_FLEET_URL=str(here.iri)), redirect_stdout(out), redirect_stderr(err), at_once:
        code = main(["mission", *arguments])
    return code, out.getvalue(), err.getvalue()


@pytest.fixture
def file(here: Fleet, tmp_path: Path) -> Path:
    found = tmp_path / "nod.json"
    found.write_text(json.dumps(nod(here, {"type": "notify", "text": "done"})))
    return found


def test_the_command_checks_imports_and_exports(here: Fleet, file: Path) -> None:
    assert command(here, "check", str(file))[:2] == (0, "the mission would be accepted; nothing has changed\n")
    assert list(here.missions) == []
    code, out, _ = command(here, "import", str(file))
    assert (code, out.strip()) == (0, str(here.missions.parts["Nod"].iri))
    code, out, _ = command(here, "export", "Nod")
    assert (code, json.loads(out)) == (0, here.missions.parts["Nod"].definition())  # type: ignore[attr-defined]
    code, out, _ = command(here, "export", "Nod", "--format", "ttl")
    assert code == 0 and "lf:SequenceStep" in out


def test_a_behavior_tree_is_a_file_of_a_mission(here: Fleet, tmp_path: Path) -> None:
    added = here.missions.add(nod(here, title="5 {nods}"))
    code, out, _ = command(here, "export", "5 {nods}", "--format", "xml")
    assert code == 0 and '<BehaviorTree ID="5_nods"' in out
    file = tmp_path / "nod.xml"
    file.write_text(out)
    before = added.definition()
    assert command(here, "import", str(file))[1].strip() == str(added.iri)
    assert added.definition() == before
    code, out, _ = command(here, "run", str(file), "angle=0.2")
    assert code == 0, out
    file.write_text("<root")
    assert "cannot be read" in command(here, "run", str(file))[2]


def test_the_command_says_what_is_wrong_with_a_file(here: Fleet, tmp_path: Path) -> None:
    wrong = tmp_path / "wrong.json"
    for text, said in (("{", "cannot be read"), ("{}", "no title"), ('{"title": "x", "step": {"type": "x"}}', "'x'")):
        wrong.write_text(text)
        code, _, err = command(here, "run", str(wrong))
        assert (code, said in err) == (1, True), err
    other = tmp_path / "nod.yaml"
    other.write_text("")
    assert ".json, .ttl, .xml" in command(here, "check", str(other))[2]


def test_the_command_runs_and_shows_each_step(here: Fleet, file: Path) -> None:
    code, out, err = command(here, "run", str(file), "--watch", "angle=0.3")
    assert code == 0, err
    assert "0.0  turn  succeeded" in out and "note: done" in out and "succeeded  http" in out
    code, out, _ = command(here, "run", str(file), "angle=0.2")
    assert code == 0 and out.startswith("succeeded")
    assert len(list(here.missions)) == 1
    code, out, _ = command(here, "run", str(file), "--watch", "--json")
    assert json.loads(out.splitlines()[-1])["state"] == "succeeded"


def test_the_command_draws_the_tree_on_a_terminal(here: Fleet, file: Path) -> None:
    code, out, _ = command(here, "run", str(file), "--watch", out=Terminal())
    last = out.rpartition("\x1b[J")[2]
    assert code == 0 and "✓     turn" in last and "Nod: succeeded" in last and "note: done" in last


def test_the_command_fails_with_the_mission(here: Fleet, tmp_path: Path) -> None:
    file = tmp_path / "fails.json"
    never = {"type": "wait", "condition": "SELECT ?a WHERE { ?a <urn:x> ?b }", "within": 0.5}
    file.write_text(json.dumps(nod(here, never)))
    code, out, _ = command(here, "run", str(file), "--watch")
    assert code == 1 and "failed" in out
    code, _, err = command(here, "run", str(file), "angle=7")
    assert code == 1 and "angle" in err


def test_an_interrupt_cancels_the_run(here: Fleet, tmp_path: Path) -> None:
    file = tmp_path / "asks.json"
    file.write_text(json.dumps(nod(here, {"type": "confirm", "text": "go?"})))
    with patch("linked_fleet_client.cli.mission_tree.Lines.show", side_effect=KeyboardInterrupt):
        code, out, err = command(here, "run", str(file), "--watch")
    assert code == 1 and "stopping it" in err and out.startswith("cancelled")


def step(path: str, state: str, **more: Any) -> StepState:
    given = {"kind": "InvokeStep", "title": "", "attempt": 1, "reason": "", "invocation": "", "started": None}
    return StepState(path=path, state=state, ended=None, **given | more)


def test_the_tree_has_the_latest_round_of_repeated_steps() -> None:
    turn = {"type": "invoke", "action": "http://h/ur5/elbow/actions/rotate"}
    kind = {"type": "invoke", "kind": "https://w3id.org/linked-fleet#StopRobot", "of": "http://h/ur5/"}
    steps = {"type": "sequence", "steps": [turn, {"type": "wait", "seconds": 1}]}
    mission = {
        "title": "M",
        "step": {"type": "parallel", "steps": [{"type": "repeat", "times": 3, "step": steps}, kind]},
    }
    states = (step("0.0.0#0.0", "succeeded"), step("0.0.0#1.0", "failed", reason="no"), step("0.1", "running"))
    assert tree_lines(mission, RunState("running", "", (), states)) == [
        "M: running",
        "    parallel",
        "      repeat 3",
        "        sequence",
        "✗         elbow rotate (round 2): no",
        "          wait 1",
        "*     StopRobot of http://h/ur5/",
    ]
