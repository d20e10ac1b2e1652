"""The gateway behaves as described: schemathesis sends permitted and forbidden requests, and finds nothing.

Motions are executed by a simulated robot. With OPENAPI_EXAMPLES set, all operations are tried with random cases.
"""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from browser import Browser
from running import eventually
from simulated_robots import simulated
from small_fleet import Place, live

pytestmark = [pytest.mark.processes, pytest.mark.test_all]
_HERE = Path(__file__).parent
_BOUNDS_S = 240.0
EXAMPLES = os.environ.get("OPENAPI_EXAMPLES", "")
"""Number of random cases per operation; without it only the examples of the description."""


def _config(folder: Path, browser: Browser, root: str) -> Path:
    """The configuration, with an object of the world and a rule: no link leads from what makes one to its id."""
    description = browser.http.get(root + "openapi.json", headers={"accept": "application/json"}).json()
    ids = ["[parameters]"]
    for path, name in (("/world/objects", "object"), ("/rules", "rule")):
        ((kind, body),) = description["paths"][path]["post"]["requestBody"]["content"].items()
        (example,) = body["examples"].values()
        made = browser.http.post(root + path[1:], content=json.dumps(example["value"]), headers={"content-type": kind})
        assert made.status_code == 201, made.text
        ids.append(f'"path.{name}" = "{made.headers["location"].rpartition("/")[2]}"')
    file = folder / "schemathesis.toml"
    file.write_text("\n".join([*ids, (_HERE / "schemathesis.toml").read_text()]))
    return file


def _run(config: Path, root: str, *more: str) -> str:
    tool, folder = str(Path(sys.executable).parent / "st"), config.parent
    command = [tool, "--config-file", str(config), "run", root + "openapi.json", "--checks", "all", "--seed", "1"]
    done = subprocess.run(
        [*command, "--no-color", *more],
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
    """Examples, a case for each constraint of a schema, random values, and sequences along the links."""
    place = Place(tmp_path)
    with place.gateway() as (gateway, browser), simulated(place.zenoh, "ur5"):
        live(browser, "ur5")
        eventually(lambda: browser.http.get(f"{place.root}ur5/tool").status_code == 200, "components")
        config = _config(tmp_path, browser, place.root)
        if EXAMPLES:
            print(_run(config, place.root, "--max-examples", EXAMPLES))
        else:
            paths = ["/{robot}/{joint}/actions/rotate", "/{robot}/{joint}/rotation", "/{robot}/title", "/{robot}/lease"]
            paths += [f"{paths[0]}/invocations/{{invocation}}", f"{paths[0]}/invocations/{{invocation}}/actions/cancel"]
            paths += ["/{robot}/{component}/output", "/{robot}/{component}/actions/stopProtectively"]
            described = browser.http.get(place.root + "openapi.json", headers={"accept": "application/json"}).json()
            assert described["paths"].keys() >= set(paths)
            _run(config, place.root, "--phases", "examples")
            _run(
                config,
                place.root,
                "--max-examples",
                "8",
                *(each for path in paths for each in ("--include-path", path)),
            )
        assert "Traceback" not in gateway.output, gateway.output[-5000:]
