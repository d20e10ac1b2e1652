"""The script for certificates keeps valid ones, and rewrites the access rules."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from certificates import SCRIPT, made
from linked_fleet_agent.wire.keys import unescape


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


ALL = "a,hall 2=x+y,any=*,door@192.0.2.7"
RUNS: list[tuple[tuple[str, ...], dict[str, list[str] | None], list[str]]] = [
    ((), {}, ["kept: a, hall 2, any, door"]),
    (("--agent", "rover"), {"rover": ["rover"]}, ["kept: a, hall 2, any, door", "added: rover"]),
    (("--agent", "a"), {}, ["kept: a, hall 2, any, door"]),
    (("--agent", "hall 2=y+z"), {"hall 2": ["y", "z"]}, ["kept: a, any, door", "changed: hall 2"]),
    (("--agent", "any"), {"any": ["any"]}, ["kept: a, hall 2, door", "changed: any"]),
    (("--remove", "a"), {"a": None}, ["kept: hall 2, any, door", "removed: a"]),
    (("--remove", "a,hall 2,any,door"), dict.fromkeys(("a", "hall 2", "any", "door")),
     ["removed: a, hall 2, any, door"]),
    (("--agent", "b,c", "--remove", "door"), {"b": ["b"], "c": ["c"], "door": None},
     ["kept: a, hall 2, any", "added: b, c", "removed: door"]),
]  # fmt: skip


def _run(folder: Path, *words: str) -> "subprocess.CompletedProcess[str]":
    return subprocess.run([sys.executable, str(SCRIPT), str(folder), *words], capture_output=True, text=True)


def _robots(folder: Path) -> dict[str, list[str]]:
    """Return the robots of each agent in access.json, as key expressions say them."""
    rules = json.loads((folder / "access.json").read_text())["rules"]
    granted = {rule["id"].removeprefix("agent "): rule["key_exprs"] for rule in rules if rule["id"][:6] == "agent "}
    chunks = {unescape(name): [key.split("/")[2] for key in keys] for name, keys in granted.items()}
    return {name: [each if each == "*" else unescape(each) for each in found] for name, found in chunks.items()}


@pytest.mark.parametrize(("words", "changes", "said"), RUNS, ids=[" ".join(run[0]) or "nothing" for run in RUNS])
def test_agents_that_are_not_named_stay(
    tmp_path: Path, words: tuple[str, ...], changes: dict[str, list[str] | None], said: list[str]
) -> None:
    """The output says what was done with each."""
    made(tmp_path, "--agent", ALL)
    before = {"a": ["a"], "hall 2": ["x", "y"], "any": ["*"], "door": ["door"]}
    assert _robots(tmp_path) == before
    done = _run(tmp_path, *words)
    assert done.returncode == 0, done.stderr
    assert _robots(tmp_path) == {name: robots for name, robots in (before | changes).items() if robots is not None}
    assert [line.removeprefix("agents ") for line in done.stdout.splitlines() if line.startswith("agents ")] == said
    assert ("restart each router" in done.stdout) == bool(changes)


def test_an_agent_that_left_keeps_its_certificate(tmp_path: Path) -> None:
    """Everything that it publishes is denied."""
    before = _contents(made(tmp_path, "--agent", "a,b"))
    after = _contents(made(tmp_path, "--agent", "c", "--remove", "a"))
    assert _named(tmp_path) == {"gateway", "router", "b", "c"}
    assert {name for name in before if before[name] != after[name]} == {"access.json", "router.json5", "ca.srl"}


OPTIONS = [
    ("--router", "router.example,192.0.2.1"),
    ("--gateway", "gateway.example"),
    ("--listen", "tls/[::]:7448"),
    ("--connect", "tls/router-2.example:7447"),
    ("--namespace", "site/hall-2"),
    ("--installed", "/etc/linked-fleet/wire"),
    ("--agent", "listening@192.0.2.7"),
]


@pytest.mark.parametrize("option", OPTIONS, ids=[option for option, _ in OPTIONS])
def test_a_run_without_an_option_keeps_what_the_earlier_run_has_set(tmp_path: Path, option: tuple[str, str]) -> None:
    before = _contents(made(tmp_path, "--agent", "a", *option))
    assert _contents(made(tmp_path)) == before


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (("--remove", "x"), "there is no such agent; there are a, b"),
        (("--remove", "a", "--agent", "a"), "in --agent and in --remove"),
    ],
)
def test_a_removal_of_nothing_is_refused(tmp_path: Path, words: tuple[str, ...], says: str) -> None:
    before = _contents(made(tmp_path, "--agent", "a,b"))
    done = _run(tmp_path, *words)
    assert (done.returncode, done.stderr.count("\n")) == (1, 1) and says in done.stderr
    assert _contents(tmp_path) == before


@pytest.mark.parametrize("name", ["access.json", "router.json5"])
def test_a_file_that_is_missing_is_made_again_from_the_other(tmp_path: Path, name: str) -> None:
    before = _contents(made(tmp_path, "--agent", "a,b=x+y"))
    (tmp_path / name).unlink()
    assert _contents(made(tmp_path)) == before


@pytest.mark.parametrize("name", ["access.json", "router.json5"])
@pytest.mark.parametrize("content", ["", "{", "[]", "{}", '{"rules": 1}', '{"rules": [{"id": "agent a"}]}'])
def test_files_of_another_form_are_refused_and_stay(tmp_path: Path, name: str, content: str) -> None:
    """Agents in them would be dropped otherwise."""
    made(tmp_path, "--agent", "a,b")
    (tmp_path / name).write_text(content)
    before = _contents(tmp_path)
    done = _run(tmp_path, "--agent", "c")
    assert (done.returncode, done.stderr.count("\n")) == (1, 1) and "name all agents" in done.stderr
    assert _contents(tmp_path) == before


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
