"""Every benchmark runs and returns rows for the table; figures of such short runs are not tested."""

import importlib
import json
import math
import os
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest

from bench import peers
from bench.crowd import Size
from bench.fan_out import Case
from bench.namespaces import full_name, namespaces
from bench.report import NETWORKS
from bench.table import Row, UnavailableError
from running import ROOT

pytestmark = [pytest.mark.processes, pytest.mark.test_all]

SHORT: Mapping[str, Mapping[str, Any]] = {
    "start": {"_": 0.0, "starts": 1},
    "answers": {"seconds": 1.0},
    "encodings": {"seconds": 0.3},
    "large": {"seconds": 0.3, "robots": 20, "requests": 2},
    "fan_out": {"seconds": 0.5, "cases": (Case("sse", 50, 200, goal=True),), "robots": 2},
    "ingest": {"seconds": 0.5, "size": Size(robots=20, joints=3, models=2, rates_hz=(50,))},
    "footprint": {"seconds": 0.5, "size": Size(robots=3, joints=3, models=2)},
    "joining": {"seconds": 0.1, "already": (2, 4)},
    "latency": {"seconds": 0.3},
    "driven_fleet": {"seconds": 0.5, "least_s": 0.5},
    "ways": {"_": 0.0, "scenes": 10},
    "planning": {"_": 0.0, "scenes": 1},
    "actions": {"seconds": 0.1},
    "parts": {"seconds": 0.3, "robots": 2},
    "transports": {"seconds": 0.3, "losses": (0.02,)},
    "links": {"seconds": 0.3, "losses": (0.02,)},
    "memory": {"_": 0.0, "steps": 2, "size": 40},
    "history": {"minutes": 2, "fleets": {"five": (2, 2, 2, 2, 2)}},
    "pages": {"seconds": 0.3, "robots": 5},
}

_SCRIPT = """import importlib, json, sys
from bench.table import UnavailableError
try:
    print(json.dumps(importlib.import_module(f"bench.{sys.argv[1]}").rows(**json.loads(sys.argv[2]))))
except UnavailableError as reason:
    print(json.dumps(str(reason)))
"""


def _rows(name: str) -> list[Row]:
    """Run a suite; one that creates network interfaces runs where browsers of other tests do not see them."""
    if name not in NETWORKS:
        rows: list[Row] = importlib.import_module(f"bench.{name}").rows(**SHORT[name])
        return rows
    paths = {"PYTHONPATH": ".:tests:tests/support"}
    with namespaces() as environment:
        words = ("tests/support/in_namespace.py", full_name("hub"), "-c", _SCRIPT, name, json.dumps(SHORT[name]))
        said = subprocess.run(
            (sys.executable, *words), cwd=ROOT, env={**environment, **paths}, stdout=subprocess.PIPE, check=True
        )
    found = json.loads(said.stdout)
    if isinstance(found, str):
        raise UnavailableError(found)
    return [Row(*each) for each in found]


@pytest.mark.parametrize("name", SHORT)
def test_a_suite_says_rows(name: str) -> None:
    try:
        rows = _rows(name)
    except UnavailableError as reason:
        pytest.skip(str(reason))
    assert rows
    assert len({row.name for row in rows}) == len(rows)
    for row in rows:
        assert math.isfinite(row.value) and (row.value >= 0 or row.unit == "MiB"), row
        assert row.ratio is None or row.ratio > 0, row
        assert (row.ratio is None) == (not row.reference), row
        assert (row.holds is None) == (not row.goal), row
    json.dumps(rows, allow_nan=False)


def test_without_other_servers_none_is_measured(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.delenv("PEERS_DIR", raising=False)
    with pytest.raises(UnavailableError, match="PEERS_DIR"):
        peers.rows(1.0)
    monkeypatch.setenv("PEERS_DIR", str(tmp_path))
    with pytest.raises(UnavailableError, match="PEERS_DIR"):
        peers.rows(1.0)


def test_other_servers_are_measured_where_they_were_built() -> None:
    if "PEERS_DIR" not in os.environ:
        pytest.skip("No other servers were built: PEERS_DIR names no folder (bench/peers.py).")
    rows = peers.rows(0.3)
    assert [row.name for row in rows if row.name.startswith("GET")]
    assert all(row.ratio is not None and row.ratio > 0 for row in rows)
