"""The trial of a release reports a step as failed if any of its commands fails."""

import re
import subprocess
from pathlib import Path

import pytest

from running import ROOT

STEPS = (ROOT / "deploy" / "try_release" / "newcomer.sh").read_text()


@pytest.mark.parametrize(("command", "word", "status"), [("true", "held", 0), ("false", "failed", 1)])
def test_a_step_holds_if_each_of_its_commands_does(command: str, word: str, status: int, tmp_path: Path) -> None:
    (step,) = re.findall(r"^step\(\) \{.*?^\}$", STEPS, re.MULTILINE | re.DOTALL)
    lines = ["set -euo pipefail", step.replace("/tmp/newcomer", str(tmp_path)), f"try() {{ {command}; true; }}"]
    done = subprocess.run(["bash", "-c", "\n".join([*lines, "step name try"])], capture_output=True, text=True)
    assert re.fullmatch(rf"{word} +\d+\.\d s  name\n", done.stdout), done.stdout + done.stderr
    assert done.returncode == status
