"""The script for certificates keeps valid ones, and rewrites the access rules."""

import json
import subprocess
import sys
from pathlib import Path

from certificates import SCRIPT, made


def _contents(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def _named(folder: Path) -> set[str]:
    access = json.loads((folder / "access.json").read_text())
    return {name for subject in access["subjects"] for name in subject["cert_common_names"]}


def test_a_second_run_keeps_everything(tmp_path: Path) -> None:
    words = ("--agent", "a,hall 2=x+y", "--router", "router.example,192.0.2.1")
    before = _contents(made(tmp_path, *words))
    assert _contents(made(tmp_path, *words)) == before
    assert "agents/hall~202.key" in before


def test_keys_are_for_their_owner_alone(tmp_path: Path) -> None:
    made(tmp_path, "--agent", "a,b")
    keys = list(tmp_path.rglob("*.key"))
    assert len(keys) == 5
    assert {path.stat().st_mode & 0o777 for path in keys} == {0o600}


def test_robots_join_and_leave(tmp_path: Path) -> None:
    """An agent that left keeps its certificate, but everything that it publishes is denied."""
    before = _contents(made(tmp_path, "--agent", "a,b"))
    after = _contents(made(tmp_path, "--agent", "b,c"))
    assert _named(tmp_path) == {"gateway", "router", "b", "c"}
    assert {name for name in before if before[name] != after[name]} == {"access.json", "router.json5", "ca.srl"}


def test_a_router_that_moves_keeps_its_key(tmp_path: Path) -> None:
    before = _contents(made(tmp_path, "--router", "one.example"))
    after = _contents(made(tmp_path, "--router", "two.example"))
    assert before["router.key"] == after["router.key"]
    assert before["router.pem"] != after["router.pem"]


def test_an_agent_called_gateway_is_refused(tmp_path: Path) -> None:
    words = [sys.executable, str(SCRIPT), str(tmp_path), "--agent", "gateway"]
    done = subprocess.run(words, capture_output=True, text=True)
    assert done.returncode == 1
    assert done.stderr.count("\n") == 1
    assert _contents(tmp_path) == {}
