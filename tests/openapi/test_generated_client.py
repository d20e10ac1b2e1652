"""A client that openapi-python-client makes of the description reads a joint, moves it, and reads it again."""

import importlib
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from running import PATIENCE_S, eventually
from simulated import simulated
from small_fleet import Place, live

pytestmark = [pytest.mark.processes, pytest.mark.test_all]
_NAME = "made_of_openapi"
_SUCCEEDED = "https://w3id.org/linked-fleet#succeeded"
_ELBOW = {"robot": "ur5", "joint": "elbow_joint"}
RAD = "http://qudt.org/vocab/unit/RAD"


@pytest.fixture(scope="module")
def client(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Any]:
    folder = tmp_path_factory.mktemp("made")
    place = Place(folder / "state")
    with place.gateway() as (_, browser), simulated(place.zenoh, "ur5"):
        live(browser, "ur5")
        _generate(folder, browser.http.get(place.root + "openapi.json").content)
        sys.path.insert(0, str(folder))
        try:
            with importlib.import_module(_NAME).Client(base_url=place.root.rstrip("/"), timeout=PATIENCE_S) as client:
                yield client
        finally:
            sys.path.remove(str(folder))


def _generate(folder: Path, description: bytes) -> None:
    (folder / "openapi.json").write_bytes(description)
    sparql = "".join(f"  application/sparql-{each}: application/octet-stream\n" for each in ("query", "update"))
    texts = f"content_type_overrides:\n{sparql}"
    (folder / "config.yml").write_text(f"package_name_override: {_NAME}\nliteral_enums: true\npost_hooks: []\n{texts}")
    tool = str(Path(sys.executable).parent / "openapi-python-client")
    said = [tool, "generate", "--path", "openapi.json", "--config", "config.yml", "--meta", "none", "--fail-on-warning"]
    said += ["--output-path", _NAME]
    done = subprocess.run(said, cwd=folder, capture_output=True, text=True, timeout=PATIENCE_S * 4, check=False)
    assert done.returncode == 0, done.stdout[-5000:] + done.stderr[-5000:]


def _call(name: str) -> Any:
    return importlib.import_module(f"{_NAME}.api.default.{name}")


def _model(name: str) -> Any:
    return getattr(importlib.import_module(f"{_NAME}.models"), name)


def test_the_client_reads_a_joint_and_moves_it(client: Any) -> None:
    """Without a word of RDF, and without setting Accept."""
    read, of = _call("read_joint_rotation").sync, {**_ELBOW, "client": client}
    before = read(**of).value
    body = _model("RotateInputRAD")(value=before + 0.05, unit=RAD)
    begun = _call("invoke_rotate").sync_detailed(**of, body=body, prefer="return=representation")
    assert begun.status_code == 201, begun
    id = begun.parsed.id
    eventually(lambda: _call("read_rotate").sync(**of, invocation=id).state == _SUCCEEDED, "the end of the motion")
    assert read(**of).value == pytest.approx(before + 0.05, abs=0.02)


def test_a_joint_beyond_its_limits_is_refused_with_the_reason(client: Any) -> None:
    body = _model("RotateInputRAD")(value=100.0, unit=RAD)
    refused = _call("invoke_rotate").sync_detailed(**_ELBOW, client=client, body=body)
    assert refused.status_code == 422 and refused.parsed.report
