"""The command line, with a server that names everything differently."""

import io
import json
import os
import signal
import subprocess
import sys
import tempfile
import threading
from contextlib import redirect_stderr, redirect_stdout
from pathlib import Path
from typing import Any
from unittest.mock import patch

import pytest
from click.shell_completion import ShellComplete

from linked_fleet_client.action import Action
from linked_fleet_client.cli.invoke import BadArgument, nested_values
from linked_fleet_client.cli.main import cli, main
from linked_fleet_client.cli.options import VARIABLE
from linked_fleet_client.cli.output import clean
from linked_fleet_client.errors import ClientError
from linked_fleet_client.invocation import Invocation
from linked_fleet_client.web import Document, Web
from running import ROOT, eventually, free_port


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def run(url: str, *arguments: str, terminal: bool = False) -> subprocess.CompletedProcess[str]:
    """Call ``main`` like a process and return output and exit code. ``tests/processes`` has real ones."""
    out, err = (Terminal(), Terminal()) if terminal else (io.StringIO(), io.StringIO())
    with patch.dict(os.environ, LINKED_FLEET_URL=url), redirect_stdout(out), redirect_stderr(err):
        try:
            code: Any = main(arguments)
        except SystemExit as ended:
            code = ended.code
    return subprocess.CompletedProcess(arguments, code, out.getvalue(), err.getvalue())


def lines(done: subprocess.CompletedProcess[str]) -> list[list[str]]:
    assert done.returncode == 0, done.stderr
    return [line.split() for line in done.stdout.splitlines()]


def test_ls_lists_parts_properties_and_actions(other_tree: Any) -> None:
    assert lines(run(other_tree.root, "ls", "cell/lefty")) == [
        ["NAME", "KIND", "VALUE"],
        ["Elbow", "Hinge"],
        ["Two%20fingers", "Gripper"],
        ["Break", "action", "Break"],
        ["Rest", "action", "Rest"],
    ]
    shown = lines(run(other_tree.root, "ls", "cell/lefty/elbow", "--unit", "rad"))
    assert ["angle", "Property", "0.218166", "rad"] in shown
    assert ["load", "Property", "unknown", "N"] in shown


def test_get_says_values_and_what_an_action_takes(other_tree: Any) -> None:
    said = run(other_tree.root, "get", "cell/lefty/elbow").stdout
    assert "12.5 deg" in said
    assert "goal  made of  (at least once, up to 2 times)" in said
    assert "from -10 to less than 90 for axis" in said
    as_json = json.loads(run(other_tree.root, "--json", "get", "cell/lefty/elbow/angle").stdout)
    assert as_json["values"]["measured"]["number"] == 12.5
    assert "blue" in run(other_tree.root, "get", "cell/lefty/elbow/mood").stdout


def test_do_has_a_nested_action_done_and_waits(other_tree: Any) -> None:
    given_ = ("goal[0].axis=Elbow", "goal[0].value=45", "goal[0].unit=deg", "tries=2")
    done = run(other_tree.root, "do", "cell/lefty/elbow", "bend", *given_, "--json")
    assert (done.returncode, json.loads(done.stdout)["state"]) == (0, "succeeded"), done.stderr
    assert len(other_tree.sent("PUT")) == 1


def test_get_describes_a_thing_with_its_parts(other_tree: Any) -> None:
    said = run(other_tree.root, "get", "cell/lefty/elbow").stdout
    assert "angle  12.5 deg" in said
    said = run(other_tree.root, "get", "cell/lefty").stdout
    assert ("    takes nothing" in said, "Elbow Two%20fingers" in said) == (True, True), said
    as_json = json.loads(run(other_tree.root, "--json", "get", "cell/lefty/elbow").stdout)
    assert as_json["properties"]["angle"]["measured"]["number"] == 12.5
    assert as_json["actions"]["Bend"]["dryRun"] is False
    mood = json.loads(run(other_tree.root, "--json", "get", "cell/lefty/elbow/mood").stdout)
    assert "blue" in str(mood["values"])


def test_an_action_is_described_with_its_input(other_tree: Any) -> None:
    assert "goal  made of" in run(other_tree.root, "get", "cell/lefty/elbow/bend").stdout
    broken = run(other_tree.root, "get", "cell/lefty/break").stdout
    assert ("It cannot be repaired." in broken, "takes nothing" in broken) == (True, True), broken
    as_json = json.loads(run(other_tree.root, "--json", "get", "cell/lefty/elbow/bend").stdout)
    assert [field["name"] for field in as_json["input"]] == ["goal", "mode", "tries"]


def test_an_invocation_is_described_by_its_state(other_tree: Any) -> None:
    said = run(other_tree.root, "get", f"{other_tree.url}/runs/2").stdout
    assert ["state", "succeeded"] in [line.split() for line in said.splitlines()]
    as_json = json.loads(run(other_tree.root, "--json", "get", f"{other_tree.url}/runs/1").stdout)
    assert (as_json["state"], as_json["result"]) == ("running", {})


def test_an_action_may_have_no_invocation(other_tree: Any) -> None:
    done = run(other_tree.root, "do", "cell/lefty", "rest")
    assert (done.returncode, "no invocation to look at" in done.stdout) == (0, True), done.stdout
    as_json = json.loads(run(other_tree.root, "do", "cell/lefty", "rest", "--json").stdout)
    assert as_json == {"iri": None, "state": None}


def test_ls_shows_a_property_or_an_action_alone(other_tree: Any) -> None:
    assert lines(run(other_tree.root, "ls", "cell/lefty/elbow/angle"))[1] == ["angle", "Property", "12.5", "deg"]
    (row,) = json.loads(run(other_tree.root, "--json", "ls", "cell/lefty/elbow/bend").stdout)
    assert (row["kind"], row["state"]) == ("action", "Bend")


def test_watch_shows_each_value_of_a_thing(other_tree: Any) -> None:
    done = run(other_tree.root, "watch", "cell/lefty/elbow", "--count", "1", "--json")
    said = [json.loads(line)["path"] for line in done.stdout.splitlines()]
    assert said == [f"cell/lefty/elbow/{name}" for name in ("angle", "load", "mood")], done.stderr


def test_a_terminal_shows_progress_and_the_latest_values(other_tree: Any) -> None:
    goal = 'goal=[{"axis": "Elbow", "value": 45, "unit": "deg"}]'
    done = run(other_tree.root, "do", "cell/lefty/elbow", "bend", goal, terminal=True)
    assert done.returncode == 0 and "succeeded" in done.stdout
    assert " s\r\x1b[K" in done.stderr, "the last state of the progress is removed"
    done = run(other_tree.root, "watch", "cell/lefty/elbow/angle", "--count", "1", terminal=True)
    assert "VALUE" in done.stdout and "12.5 deg" in done.stdout


@pytest.mark.parametrize(
    ("error", "said"), [(None, "stopping it"), (ClientError("it is broken"), "goes on: it is broken")]
)
def test_an_interrupt_cancels_the_invocation(other_tree: Any, error: ClientError | None, said: str) -> None:
    goal = 'goal=[{"axis": "Elbow", "value": 45, "unit": "deg"}]'
    waits = patch.object(Invocation, "wait", side_effect=[KeyboardInterrupt, "cancelled"])
    with waits, patch.object(Invocation, "cancel", side_effect=error) as cancel:
        done = run(other_tree.root, "do", "cell/lefty/elbow", "bend", goal)
    assert (done.returncode, cancel.call_count, said in done.stderr) == (1, 1, True), done.stderr


def test_an_interrupt_before_the_response_says_that_the_action_may_have_begun(other_tree: Any) -> None:
    with patch.object(Action, "__call__", side_effect=KeyboardInterrupt):
        done = run(other_tree.root, "do", "cell/lefty", "rest")
    assert (done.returncode, "may have begun" in done.stderr) == (130, True), done.stderr


def test_no_wait_says_where_to_look(other_tree: Any) -> None:
    goal = 'goal=[{"axis": "Elbow", "value": 45, "unit": "deg"}]'
    done = run(other_tree.root, "do", "cell/lefty/elbow", "bend", goal, "--no-wait")
    assert (done.returncode, done.stdout.split()[-1]) == (0, f"{other_tree.url}/jobs/0")


@pytest.mark.parametrize(
    ("arguments", "code", "said"),
    [
        (["do", "cell/lefty/elbow", "bend", "goal.axis=Elbow", "goal.value=91", "goal.unit=deg"], 1, "less than 90"),
        (["do", "cell/lefty/elbow", "bend", "goal.axis=Elbow"], 1, "goal.value is missing; goal.unit is missing"),
        (["do", "cell/lefty", "break"], 1, "it is broken"),
        (["do", "cell/lefty", "rest", "--dry-run"], 1, "dryRun"),
        (["do", "cell/lefty", "fly"], 4, "Break, Rest"),
        (["do", "cell/lefty/elbow/angle", "bend"], 4, "not a thing"),
        (["stop", "cell/lefty/elbow/angle"], 4, "not a thing"),
        (["do", "cell/lefty", "rest", "fast"], 2, "name=value"),
        (["get", "cell/nobody"], 4, "lefty"),
        (["stop"], 4, "stop"),
        (["ls", "--wrong"], 2, "Usage"),
        (["do", "cell/lefty", "rest", "--seconds", "nan"], 2, "nan is not a number of seconds"),
        (["watch", "cell", "--count", "0"], 2, "--count"),
        (["ls", "--url"], 2, "requires an argument"),
        ([], 2, "Usage"),
    ],
)
def test_errors_have_an_exit_code_and_a_reason(other_tree: Any, arguments: list[str], code: int, said: str) -> None:
    done = run(other_tree.root, *arguments)
    assert (done.returncode, said in done.stderr) == (code, True), done.stderr
    assert "Traceback" not in done.stderr
    assert other_tree.sent("PUT") == []


def test_an_unreachable_server_has_exit_code_3() -> None:
    done = run("http://127.0.0.1:1/", "--url", f"http://127.0.0.1:{free_port()}/", "ls")
    assert (done.returncode, "cannot be reached" in done.stderr) == (3, True)


@pytest.mark.processes
def test_watch_prints_what_changes(other_tree: Any) -> None:
    """It runs in a process, because the end of a process also ends its threads."""
    paths = ("cell/lefty/elbow/angle", "cell/lefty/elbow/load")
    command = [
        sys.executable,
        "-W",
        "error",
        "-m",
        "linked_fleet_client.cli.main",
        "--url",
        other_tree.root,
        "watch",
        *paths,
    ]
    done = subprocess.run(
        [*command, "--count", "2", "--json"], cwd=ROOT, capture_output=True, text=True, timeout=60, check=True
    )
    said = {each["path"]: each["values"] for each in map(json.loads, done.stdout.splitlines())}
    assert said["cell/lefty/elbow/angle"]["measured"]["number"] == 12.5
    assert said["cell/lefty/elbow/load"]["value"]["number"] is None


def test_threads_of_watch_end_before_the_client_does(other_tree: Any) -> None:
    """No thread is left or raises, which pytest would report. The server may log a closed connection."""
    before = set(threading.enumerate())
    paths = ("cell/lefty/elbow/angle", "cell/lefty/elbow/load", "cell/lefty/elbow/mood")
    done = run(other_tree.root, "watch", *paths, "--count", "1")
    assert (done.returncode, len(done.stdout.splitlines())) == (0, 1), done.stderr
    assert "_follow" not in done.stderr
    left = [each.name for each in threading.enumerate() if each not in before and "_follow" in each.name]
    assert left == []


def test_ctrl_c_does_not_interrupt_the_client_within_a_request(
    other_tree: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In the thread that has the request it could leave connections locked, or be swallowed; that cancels nothing."""
    other_tree.endless = True
    get, lookers = Web.get, list[threading.Thread]()

    def look(self: Web, iri: str) -> Document:
        if iri.endswith("/jobs/0"):
            lookers.append(threading.current_thread())
            if len(lookers) == 3:
                signal.raise_signal(signal.SIGINT)
        return get(self, iri)

    monkeypatch.setattr(Web, "get", look)
    done = run(
        other_tree.root,
        "do",
        "cell/lefty/elbow",
        "bend",
        'goal=[{"axis": "Elbow", "value": 45, "unit": "deg"}]',
        "--json",
    )
    assert (done.returncode, json.loads(done.stdout)["state"]) == (1, "cancelled"), done.stderr
    assert "stopping it" in done.stderr
    assert threading.main_thread() not in lookers[:3]


@pytest.mark.processes
def test_ctrl_c_cancels_what_is_running(other_tree: Any) -> None:
    """It cancels by the invocation's own action; the process reports it and ends with 1."""
    other_tree.endless = True
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "LINKED_FLEET_URL": other_tree.root}
    goal = 'goal=[{"axis": "Elbow", "value": 45, "unit": "deg"}]'
    command = [sys.executable, "-m", "linked_fleet_client.cli.main", "do", "cell/lefty/elbow", "bend", goal, "--json"]
    with subprocess.Popen(command, env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as child:
        eventually(lambda: other_tree.looks.get("/jobs/0", 0) > 2, "somebody looks at the job")
        child.send_signal(signal.SIGINT)
        out, err = child.communicate(timeout=60)
    assert out, (child.returncode, err)
    assert (child.returncode, json.loads(out)["state"]) == (1, "cancelled"), err


HINTED = "If the fleet is elsewhere, give its address with --url or in LINKED_FLEET_URL.\n"


@pytest.mark.parametrize(
    ("answered", "code", "hinted"),
    [
        (None, 3, True),
        (b"HTTP/1.1 200 X\r\ncontent-type: text/html\r\ncontent-length: 2\r\nconnection: close\r\n\r\nhi", 3, True),
        (b"HTTP/1.1 404 X\r\ncontent-length: 0\r\nconnection: close\r\n\r\n", 4, True),
        (b"SSH-2.0-nothing\r\n", 3, True),
        (b"HTTP/1.1 401 X\r\ncontent-length: 0\r\nconnection: close\r\n\r\n", 1, False),
        (b"HTTP/1.1 500 X\r\ncontent-length: 0\r\nconnection: close\r\n\r\n", 3, False),
    ],
)
@pytest.mark.parametrize("command", [["ls"], ["do", "ur5", "stop"], ["watch", "ur5"], ["stop"]])
def test_a_wrong_address_hints_at_the_option(
    script: Any, command: list[str], answered: bytes | None, code: int, hinted: bool
) -> None:
    """In one sentence, if nobody answers or another server does."""
    script.answers["/"] = [answered or b""]
    done = run(f"http://127.0.0.1:{free_port()}/" if answered is None else f"{script.url}/", *command)
    assert (done.returncode, done.stderr.endswith(HINTED)) == (code, hinted), done.stderr


def test_other_errors_do_not_hint_at_the_address(other_tree: Any) -> None:
    """Neither those of a fleet that has answered, nor those of an address that is given as path."""
    elsewhere = f"http://127.0.0.1:{free_port()}/"
    for command in (["get", "cell/nobody"], ["do", "cell/lefty", "break"], ["get", elsewhere]):
        done = run(other_tree.root, *command)
        assert done.returncode and HINTED not in done.stderr, done.stderr


def test_completion_offers_existing_names(other_tree: Any) -> None:
    def offered(*words: str, url: str = other_tree.root) -> list[str]:
        *before, typed = words
        with patch.dict(os.environ, LINKED_FLEET_URL=url):
            found = ShellComplete(cli, {}, "linked-fleet", VARIABLE).get_completions(before, typed)
        return [item.value for item in found]

    assert offered("ge") == ["get"]
    assert "gateway" in offered("g")
    assert offered("conf") == ["conform"]
    assert offered("ls", "cell/le") == ["cell/lefty"]
    assert offered("ls", "cell/lefty/elbow/l") == ["cell/lefty/elbow/load"]
    assert offered("watch", "cell", "cell/lefty/elbow/l") == ["cell/lefty/elbow/load"]
    assert offered("do", "cell/lefty/T") == ["cell/lefty/Two%20fingers"]
    assert offered("do", "cell/lefty", "B") == ["Break"]
    assert offered("do", "cell/lefty/Elbow", "Bend", "") == ["goal=", "mode=", "tries="]
    assert offered("do", "cell/lefty/Elbow", "Bend", "mode=") == ["mode=soft", "mode=hard"]
    assert offered("ls", "nobody/") == []
    nobody = f"http://127.0.0.1:{free_port()}/"
    assert offered("--url", other_tree.root, "do", "cell/lefty", "Re", url=nobody) == ["Rest"]
    assert offered("do", "--url", other_tree.root, "cell/lefty", "Re", url=nobody) == ["Rest"]
    assert offered("ls", "", url=nobody) == []
    assert offered("do", "cell/lefty", "--dr") == ["--dry-run"]


@pytest.mark.processes
@pytest.mark.test_all
@pytest.mark.parametrize(
    ("words", "found"),
    [
        ("('do' 'cell/lefty/Elbow' 'Bend' 'mode' '=' 's')", ["soft"]),
        ("('--url' 'http' ':' '//127.0.0.1' ':' 'PORT/start' 'do' 'cell/lefty' 'Re')", ["Rest"]),
    ],
)
def test_the_script_for_bash_completes(other_tree: Any, words: str, found: list[str]) -> None:
    """In a real bash, with linked-fleet on the path. bash splits words at ``=`` and ``:``."""
    script = run(other_tree.root, "completion", "bash")
    assert script.returncode == 0
    port = other_tree.url.rpartition(":")[2]
    ask = f"""
{script.stdout}
COMP_WORDS=(linked-fleet "${{words[@]}}")
COMP_CWORD=$(( ${{#COMP_WORDS[@]}} - 1 ))
compopt() {{ :; }}
_linked_fleet_completion "$PWD/linked-fleet"; printf '%s\\n' "${{COMPREPLY[@]}}"
"""
    with tempfile.TemporaryDirectory() as folder:
        program = Path(folder, "linked-fleet")
        program.write_text(
            f"#!{sys.executable}\nimport sys\nfrom linked_fleet_client.cli.main import main\nsys.exit(main())\n"
        )
        program.chmod(0o755)
        environment = {**os.environ, "PYTHONPATH": str(ROOT), "LINKED_FLEET_URL": other_tree.root}
        done = subprocess.run(
            ["bash", "-c", f"words={words.replace('PORT', port)}\n{ask}"],
            env=environment, cwd=folder, capture_output=True, text=True, timeout=60, check=True,
        )  # fmt: skip
    assert done.stdout.split() == found, done.stderr


@pytest.mark.parametrize("shell", ["fish", "zsh"])
def test_other_shells_have_scripts(shell: str) -> None:
    script = run("http://127.0.0.1:1/", "completion", shell).stdout
    assert VARIABLE in script
    assert "compadd -U" not in script


@pytest.mark.parametrize(
    ("arguments", "found"),
    [
        (["a=1", "b=x=y"], {"a": "1", "b": "x=y"}),
        (["a=1", "a=2", "a=3"], {"a": ["1", "2", "3"]}),
        (["a.b=1", "a.c.d=2"], {"a": {"b": "1", "c": {"d": "2"}}}),
        (["a[1].b=1", "a[0].b=2", "a[0].c=3"], {"a": [{"b": "2", "c": "3"}, {"b": "1"}]}),
        (["a[0]=x"], {"a": ["x"]}),
        (['a={"b": [1]}'], {"a": {"b": [1]}}),
    ],
)
def test_arguments_are_a_nested_mapping(arguments: list[str], found: dict[str, Any]) -> None:
    assert nested_values(arguments) == found


@pytest.mark.parametrize(
    "argument", [["a"], ["=1"], ["a..b=1"], ["a[x]=1"], ["a={"], ["a=1", "a.b=2"], ["a.b=1", "a[0]=1"]]
)
def test_other_arguments_are_refused(argument: list[str]) -> None:
    with pytest.raises(BadArgument):
        nested_values(argument)


def test_nothing_from_the_network_steers_the_terminal() -> None:
    assert clean("a\x1b[2J\r\n\u202eb\x07") == "a [2J   b "


def test_the_help_lists_each_command_on_a_line_of_its_own() -> None:
    """It is a newcomer's first impression: no line is truncated, and each describes its command."""
    listed = run("http://127.0.0.1:1/", "--help").stdout.partition("Commands:\n")[2].splitlines()
    said = dict(line.split(maxsplit=1) for line in listed)
    assert {"demo", "gateway", "agent", "ls", "do", "watch", "conform", "doctor"} <= set(said)
    assert [line for line in listed if line.endswith("...") or not line.endswith(".")] == []
    assert all(len(about.split()) > 2 for about in said.values())
