"""The trial of a release reports a step as failed if any of its commands fails."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

from running import ROOT, eventually

STEPS = (ROOT / "deploy" / "try_release" / "newcomer.sh").read_text()


@pytest.mark.parametrize(("command", "word", "status"), [("true", "held", 0), ("false", "failed", 1)])
def test_a_step_holds_if_each_of_its_commands_does(command: str, word: str, status: int, tmp_path: Path) -> None:
    (step,) = re.findall(r"^step\(\) \{.*?^\}$", STEPS, re.MULTILINE | re.DOTALL)
    lines = ["set -euo pipefail", step.replace("/tmp/newcomer", str(tmp_path)), f"try() {{ {command}; true; }}"]
    done = subprocess.run(["bash", "-c", "\n".join([*lines, "step name try"])], capture_output=True, text=True)
    assert re.fullmatch(rf"{word} +\d+\.\d s  name\n", done.stdout), done.stdout + done.stderr
    assert done.returncode == status


def test_a_reader_installs_the_packages_that_the_pages_name(tmp_path: Path) -> None:
    """The trial installs no others, so that it fails if the pages leave one out."""
    source = tmp_path / "source.tar"
    subprocess.run(["tar", "-cf", source, "README.md", "docs/TUTORIAL.md"], cwd=ROOT, check=True)
    (named,) = re.findall(r"^named\(\) \{.*?^\}$", STEPS, re.MULTILINE | re.DOTALL)
    lines = ["set -euo pipefail", named.replace("/source.tar", str(source)), "named"]
    said = subprocess.run(["bash", "-c", "\n".join(lines)], capture_output=True, text=True, check=True).stdout
    assert said.split() == ["curl", "git", "libgomp1", "make", "pipx", "python3-venv"]


def test_a_process_that_is_left_is_found(tmp_path: Path) -> None:
    """The search is for the name that all processes of the product have in their command lines."""
    (search,) = re.findall(r"^none_left\(\) \{.*?^\}$", STEPS, re.MULTILINE | re.DOTALL)
    assert "'linked[_-]fleet' /proc/[0-9]*" in search
    ours = search.replace("linked[_-]fleet", f"{tmp_path.name[:3]}[{tmp_path.name[3]}]{tmp_path.name[4:]}")
    command = ["bash", "-c", f"{ours}\nnone_left"]
    assert subprocess.run(command).returncode == 0
    with subprocess.Popen([sys.executable, "-c", "input()", tmp_path.name], stdin=subprocess.PIPE):
        eventually(lambda: subprocess.run(command).returncode == 1, "the process found")
