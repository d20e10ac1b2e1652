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
from typing import Any

import httpx
import pytest

from browser import Browser
from demonstration import Demo
from redis_servers import Server
from running import ROOT, eventually
from tests.requirements import test_actions, test_figures


@pytest.fixture
def demo(tmp_path: Path) -> Iterator[Demo]:
    demo = Demo(tmp_path)
    try:
        yield demo
    finally:
        for pid in [*demo.members(), *demo.servers()]:
            os.kill(pid, signal.SIGKILL)
        demo.process.wait()


ROBOTS = {"baxter", "ur5", "panda", "tiago", "go2", "pmb2"}
PROCESSES = 9  # the demo, the gateway, an agent for each robot, and the contacts between them
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


def _stops_a_robot_that_touches_something(demo: Demo) -> None:
    """A crate is put into the way of an arm that moves already, which no check of the motion knows."""
    panda, unit = f"{demo.root}panda/", "http://qudt.org/vocab/unit/"

    def move(positions: dict[int, float], scale: float, prefer: str) -> None:
        targets = [
            {"joint": f"{panda}panda_joint{n}", "value": value, "unit": f"{unit}RAD"} for n, value in positions.items()
        ]
        body = {"target": targets, "speedScale": scale}
        answer = httpx.post(f"{panda}actions/moveJoints", json=body, headers={"prefer": prefer}, timeout=30)
        assert answer.status_code in (202, 204), answer.text

    move({1: -0.5, 2: 0.4, 4: -1.9}, 1.0, "wait=20")
    eventually(lambda: abs(_value(f"{panda}panda_joint1/rotation") + 0.5) < 0.01, "the arm is to the right")
    move({1: 1.5}, 0.2, "respond-async")
    where, size = ({"x": x, "y": y, "z": z, "unit": f"{unit}M"} for x, y, z in ((0.45, 4.25, 0.4), (0.3, 0.1, 0.8)))
    geometry = {"form": "https://w3id.org/linked-fleet#Box", "size": size}
    crate = httpx.post(f"{demo.root}world/objects", json={"title": "crate", "position": where, "geometry": geometry})
    assert crate.status_code == 201, crate.text
    mode = eventually(lambda: said if (said := _json(f"{panda}mode"))["protectiveStop"] else None, "it is stopped")
    assert re.fullmatch(r"contact: panda_link\d of panda touches crate", mode["reason"])
    assert _value(f"{panda}panda_joint1/rotation") < 0.6
    httpx.delete(crate.headers["location"])


def _json(url: str) -> dict[str, Any]:
    found: dict[str, Any] = httpx.get(url, headers={"accept": "application/json"}).json()
    return found


def _value(url: str) -> float:
    return float(_json(url)["value"])


def test_the_demo_starts_serves_and_ends_on_ctrl_c(demo: Demo) -> None:
    eventually(lambda: demo.robots_online() == 6, "six robots online")
    eventually(lambda: f"The fleet is at http://127.0.0.1:{demo.port}/" in demo.output, "the root's address is printed")
    _turns_what_it_says(demo)
    _has_the_figures(demo)
    _stops_a_robot_that_touches_something(demo)
    assert len(demo.members()) == PROCESSES
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
    eventually(lambda: len(demo.members()) == PROCESSES, "all its processes")
    demo.process.kill()
    demo.process.wait()
    eventually(lambda: not demo.members(), "every child has ended")


def _ready(demo: Demo) -> None:
    eventually(lambda: "Ctrl-C ends the demo." in demo.output, lambda: demo.output)


def _crate(demo: Demo) -> str:
    """Create an object in the world, which the store keeps. Return its address."""
    body = """@prefix lf: <https://w3id.org/linked-fleet#> . @prefix dcterms: <http://purl.org/dc/terms/> .
@prefix maths: <http://vocab.arvida.de/2015/06/maths/vocab#> . @prefix unit: <http://qudt.org/vocab/unit/> .
@prefix vom: <http://vocab.arvida.de/2015/06/vom/vocab#> .
<> a lf:Obstacle ; dcterms:title "crate" ;
    lf:position [ maths:x 9 ; maths:y 9 ; maths:z 0.3 ; vom:unit unit:M ] ;
    lf:geometry [ a lf:Box ; lf:size [ maths:x 0.4 ; maths:y 0.6 ; maths:z 0.6 ; vom:unit unit:M ] ] ."""
    made = httpx.post(f"{demo.root}world/objects", content=body, headers={"content-type": "text/turtle"})
    assert made.status_code == 201, made.text
    return made.headers["location"]


def test_nothing_of_an_earlier_demo_comes_back(tmp_path: Path) -> None:
    """Neither after Ctrl-C nor after a kill: it leaves no folder either."""
    first = Demo(tmp_path)
    _ready(first)
    kept = _crate(first)
    assert httpx.get(kept).status_code == 200
    assert "away" not in first.output
    first.process.kill()
    first.process.wait()
    eventually(lambda: not (first.members() or first.servers()), "the end of all processes")
    second = Demo(tmp_path, port=first.port)
    _ready(second)
    assert httpx.get(kept).status_code == 404
    assert len(list(tmp_path.glob("linked-fleet-demo-*"))) == 1
    assert second.interrupt() in (0, 130)
    assert list(tmp_path.glob("linked-fleet-demo-*")) == []


def test_two_demos_of_one_account_do_not_share_their_store(demo: Demo, tmp_path: Path) -> None:
    """What one keeps outlives the end of the other, whose store ends with it."""
    other = Demo(tmp_path)
    try:
        for each in (demo, other):
            _ready(each)
        assert len(demo.servers()) == 2
        kept = _crate(other)
        assert demo.interrupt() in (0, 130)
        assert len(other.servers()) == 1
        assert httpx.get(kept).status_code == 200
        assert _crate(other) != kept
        assert "away" not in other.output
    finally:
        other.interrupt()


def test_each_robot_has_an_agent_of_its_own(demo: Demo) -> None:
    """The end of one agent is the absence of its robot; the others go on, and it comes back by the printed command."""
    _ready(demo)
    assert set(demo.agents()) == ROBOTS
    os.kill(demo.agents()["panda"], signal.SIGKILL)
    eventually(lambda: demo.robots_online() == 5, "one robot is offline")
    said = eventually(lambda: re.search(r"The panda process has ended .* again:\n  (.*)\n", demo.output), demo.output)
    again = subprocess.Popen(shlex.split(said[1]), stderr=subprocess.DEVNULL)
    try:
        eventually(lambda: demo.robots_online() == 6, "six robots online")
    finally:
        again.kill()
        again.wait()


def test_a_killed_gateway_is_started_again_and_knows_what_it_knew(demo: Demo) -> None:
    _ready(demo)
    crate, killed = _crate(demo), demo.gateway()
    os.kill(killed, signal.SIGKILL)
    eventually(lambda: "is started again" in demo.output, lambda: demo.output)
    eventually(lambda: demo.robots_online() == 6 and demo.gateway() != killed, lambda: demo.output)
    assert httpx.get(crate).status_code == 200
    assert demo.interrupt() == 0


def test_the_demo_starts_without_the_redis_that_the_user_names(tmp_path: Path) -> None:
    """Warnings are printed and end nothing; what needs Redis is named, and follows when Redis is there."""
    server = Server(tmp_path)
    server.kill()
    demo = Demo(tmp_path, "--redis-url", server.url)
    try:
        _ready(demo)
        assert "Redis is unavailable" in demo.output
        assert "6 of 6 robots could not be placed in the world" in demo.output
        assert demo.robots_online() == 6
        server.start()
        eventually(lambda: _position(demo, "panda") == "4.0", "the robots are placed")
        assert demo.interrupt() in (0, 130)
    finally:
        demo.kill()
        server.discard()


def _position(demo: Demo, robot: str) -> str:
    """Return y of the placement of a robot."""
    text = httpx.get(f"{demo.root}{robot}/placement", headers={"accept": "application/n-triples"}).text
    found = re.search(r'#y> "([^"]+)"', text)
    return found[1] if found else ""


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
