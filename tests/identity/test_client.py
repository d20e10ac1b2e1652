"""The client says who it is to its own fleet, and to nobody else."""

import os
import subprocess
import sys

import pytest
from guarded import Guarded
from receivers import Answer, receiving
from running import ROOT

from client.fleet import Fleet

pytestmark = pytest.mark.fleet


def test_the_command_line_takes_a_token(here: Guarded) -> None:
    def ls(token: str) -> subprocess.CompletedProcess[str]:
        environment = os.environ | {"PYTHONPATH": str(ROOT), "LINKED_FLEET_URL": here.root, "LINKED_FLEET_TOKEN": token}
        command = [sys.executable, "-m", "client.cli.main", "ls"]
        return subprocess.run(command, env=environment, capture_output=True, text=True, timeout=60, check=False)

    said = ls(here.tokens["lab"])
    assert said.returncode == 0, said.stderr
    assert said.stdout.count("Robot") == 1
    assert ls(here.tokens["all"]).stdout.count("Robot") >= 2
    nobody = ls("")
    assert nobody.returncode != 0 and "Traceback" not in nobody.stderr


def test_a_token_goes_nowhere_else(here: Guarded) -> None:
    with receiving() as other, Fleet(here.root, token=here.tokens["lab"]) as fleet:
        other.default = Answer(200, {"Content-Type": "text/turtle"}, b"<> a <http://x.example/Thing> .")
        fleet.web.get(other.url("/elsewhere"))
        (seen,) = other.wait(1)
        assert "authorization" not in seen.headers
        assert fleet.web.get(here.root).graph
