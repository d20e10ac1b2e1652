"""``linked-fleet-agent --check``: what it prints of drivers and components, and what is wrong with them."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

from linked_fleet_agent.check import check

ROOT = Path(__file__).parents[3]


def written(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "part.py"
    path.write_text(f"from linked_fleet_agent.components import *\nfrom typing import Any\n{text}")
    return path


def test_the_page_shows_what_it_prints() -> None:
    done = subprocess.run(
        [sys.executable, "-m", "linked_fleet_agent", "--check", "examples/gripper.py"],
        cwd=ROOT, capture_output=True, text=True, check=True,
    )  # fmt: skip
    [shown] = re.findall(r"^```\n(component gripper.*?)^```$", (ROOT / "docs/COMPONENTS.md").read_text(), re.M | re.S)
    assert (done.stdout, done.stderr) == (shown, "")


@pytest.mark.parametrize(
    ("example", "said"),
    [
        ("switch_box.py", "robot switch_box: Switch box, fixed base"),
        (
            "switch_box.py",
            "  component output4: Output4, https://w3id.org/linked-fleet#Switch; 10 Hz, unknown after 1 s",
        ),
        ("picker.py", '    feedback: {part: integer, doing: "approach" | "place" | "take"}'),
        ("driver.py", "  joint pan [rad], takes commands, arrives within 0.00153 rad"),
    ],
)
def test_it_shows_robots_and_components(example: str, said: str) -> None:
    lines, problems = check(ROOT / "examples" / example)
    assert said in lines
    assert problems == []


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("1 / 0", "part.py cannot be run: ZeroDivisionError: division by zero"),
        ("x = 1", "defines neither a component nor a driver, which has describe, read, apply, stop, close"),
        ("class A(Component):\n    @action()\n    def go(self, x): ...", "a.go: the parameter 'x' has no annotation"),
        ("class A(Component):\n    @value\n    def x(self) -> dict[str, int]: ...", "a.x: dict has no schema"),
        (
            "class A(Gripper):\n    @value\n    def width(self) -> float: ...",
            "a: a Gripper has a property 'width' in M; this one's is without unit",
        ),
        (
            "from linked_fleet_agent.robots.of_components import RobotOfComponents\n"
            "class A(Battery): ...\n"
            "def robot() -> RobotOfComponents: return RobotOfComponents('R', A())",
            "robot: a: a Battery has a property 'charge'; this one has none",
        ),
        ("class A(Component, rate_hz=0):\n    '''It.'''", "a: Expected `float` > 0"),
        (
            "from linked_fleet_agent.robots.of_components import RobotOfComponents\n"
            "class A(Component):\n    @action(moves=['leg'])\n    def go(self) -> None: ...\n"
            "def robot() -> RobotOfComponents: return RobotOfComponents('R', A())",
            "robot: component 'a' is refused: action 'go' moves 'leg', which is neither a joint of the robot",
        ),
    ],
)
def test_it_says_what_is_wrong(tmp_path: Path, text: str, said: str) -> None:
    _, problems = check(written(tmp_path, text))
    assert said in " ".join(problems)


def test_it_exits_with_1_if_something_is_wrong_and_2_for_wrong_use(tmp_path: Path) -> None:
    for arguments, code, said in (
        (["--check", str(written(tmp_path, "x = 1"))], 1, "wrong: "),
        (["--check"], 2, "--check takes one file"),
        (["--robot", "a", "--check", "b"], 2, "--check FILE stands alone"),
    ):
        done = subprocess.run(
            [sys.executable, "-m", "linked_fleet_agent", *arguments], capture_output=True, text=True, check=False
        )
        assert (done.returncode, said in done.stderr) == (code, True), done
