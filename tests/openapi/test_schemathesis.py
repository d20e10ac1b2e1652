"""The gateway is as its description says: schemathesis sends what it allows and what it forbids, and finds nothing.

Motions are really made, by a simulated robot. With OPENAPI_EXAMPLES set, all operations are tried with drawn cases.
"""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from simulated import simulated
from small_fleet import Place, live

pytestmark = [pytest.mark.processes, pytest.mark.test_all]
_HERE = Path(__file__).parent
_BOUNDS_S = 240.0
EXAMPLES = os.environ.get("OPENAPI_EXAMPLES", "")
"""The most cases of one operation that are drawn, each of any values; without it those of the description."""


def _command(root: str, *more: str) -> list[str]:
    tool = str(Path(sys.executable).parent / "st")
    config = str(_HERE / "schemathesis.toml")
    return [tool, "--config-file", config, "run", root + "openapi.json", "--checks", "all", "--seed", "1", *more]


def _run(folder: Path, root: str, *more: str) -> str:
    done = subprocess.run(
        _command(root, "--no-color", *more),
        capture_output=True,
        text=True,
        timeout=_BOUNDS_S * 4,
        cwd=folder,
        env=os.environ | {"SCHEMATHESIS_HOOKS": "schemathesis_hooks", "PYTHONPATH": str(_HERE)},
        check=False,
    )
    assert done.returncode == 0, done.stdout[-20_000:] + done.stderr[-2000:]
    return done.stdout


def test_schemathesis_finds_nothing(tmp_path: Path) -> None:
    """Examples, a case for each thing that a schema says, drawn values, and sequences along the links."""
    place = Place(tmp_path)
    with place.gateway() as (gateway, browser), simulated(place.zenoh, "ur5"):
        live(browser, "ur5")
        if EXAMPLES:
            print(_run(tmp_path, place.root, "--max-examples", EXAMPLES))
        else:
            paths = ["/{robot}/{joint}/actions/rotate", "/{robot}/{joint}/rotation", "/{robot}/title", "/{robot}/lease"]
            paths += [f"{paths[0]}/invocations/{{invocation}}", f"{paths[0]}/invocations/{{invocation}}/actions/cancel"]
            _run(tmp_path, place.root, "--phases", "examples")
            _run(
                tmp_path,
                place.root,
                "--max-examples",
                "8",
                *(each for path in paths for each in ("--include-path", path)),
            )
        assert "Traceback" not in gateway.output, gateway.output[-5000:]
