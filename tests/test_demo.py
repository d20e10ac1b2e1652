"""``python -m linked_fleet_demo`` as a user runs it: it starts, answers, and Ctrl-C leaves nothing behind."""

import contextlib
import os
import re
import shlex
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import httpx
import pytest
import test_actions
import test_figures

from browser import Browser
from demonstration import Demo
from running import ROOT, eventually


@pytest.fixture
def demo(tmp_path: Path) -> Iterator[Demo]:
    demo = Demo(tmp_path)
    try:
        yield demo
    finally:
        for pid in [*demo.members(), *demo.servers()]:
            os.kill(pid, signal.SIGKILL)
        demo.process.wait()


pytestmark = [
    pytest.mark.processes,
    pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="counts processes in /proc"),
]


def _turns_what_it_says(demo: Demo) -> None:
    """The printed command, as a newcomer copies it, works when it is printed."""
    printed = eventually(lambda: re.search(r"curl (-i .*?\.')\n", demo.output, re.DOTALL), "a command to turn a joint")
    _, _, field, url, _, body = shlex.split(printed[1])
    name, value = field.split(": ")
    accepted = httpx.post(url, content=body, headers={name: value})
    assert accepted.status_code == 204, accepted.text


def _has_the_figures(demo: Demo) -> None:
    """The figures of the paper hold with the demo's placement of robots; the motion of Figure 5b completes."""
    with contextlib.closing(Browser(f"http://127.0.0.1:{demo.port}/")) as browser:
        for name in (each for each in dir(test_figures) if each.startswith("test_figure")):
            getattr(test_figures, name)(browser)
        test_actions.test_figure_5b_turns_the_joint(browser)


def test_the_demo_starts_serves_and_ends_on_ctrl_c(demo: Demo) -> None:
    eventually(lambda: demo.robots_online() == 5, "five robots online")
    eventually(lambda: f"The fleet is at http://127.0.0.1:{demo.port}/" in demo.output, "the root's address is printed")
    _turns_what_it_says(demo)
    _has_the_figures(demo)
    assert len(demo.members()) == 3  # the demo, the gateway, the agents
    assert len(demo.servers()) == 1
    assert demo.interrupt() in (0, 130)
    assert (demo.members(), demo.servers()) == ([], [])
    assert "Traceback" not in demo.output
    assert "killed" not in demo.output


def test_ctrl_c_while_it_loads_leaves_nothing_behind(demo: Demo) -> None:
    eventually(lambda: "Starting the gateway" in demo.output, "the demo says what it does")
    assert demo.interrupt() in (0, 130)
    assert (demo.members(), demo.servers()) == ([], [])
    assert "Traceback" not in demo.output


def test_a_killed_demo_leaves_no_orphans(demo: Demo) -> None:
    eventually(lambda: len(demo.members()) == 3, "the demo, the gateway, the agents")
    demo.process.kill()
    demo.process.wait()
    eventually(lambda: not demo.members(), "every child has ended")


def test_a_taken_port_is_one_line(tmp_path: Path) -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        answer = subprocess.run(
            [sys.executable, "-m", "linked_fleet_demo", "--port", str(port)],
            cwd=ROOT,
            capture_output=True,
            text=True,
            check=False,
        )
    assert answer.returncode == 1
    assert answer.stdout == ""
    assert len(answer.stderr.splitlines()) == 1
    assert f"127.0.0.1:{port}" in answer.stderr
