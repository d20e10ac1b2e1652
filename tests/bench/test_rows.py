"""That every benchmark still runs, and says what the table needs: what it finds in so short a time is not looked at."""

import importlib
import json
import math
from collections.abc import Mapping
from typing import Any

import pytest

from bench.table import UnavailableError

pytestmark = pytest.mark.fleet

SHORT: Mapping[str, Mapping[str, Any]] = {
    "answers": {"seconds": 1.0},
    "latency": {"seconds": 0.3},
    "actions": {"seconds": 0.1},
    "transports": {"seconds": 0.3, "losses": (0.02,)},
    "links": {"seconds": 0.3, "losses": (0.02,)},
    "memory": {"_": 0.0, "steps": 2, "size": 40},
    "pages": {"seconds": 0.3, "robots": 5},
}


@pytest.mark.parametrize("name", SHORT)
def test_a_suite_says_rows(name: str) -> None:
    try:
        rows = importlib.import_module(f"bench.{name}").rows(**SHORT[name])
    except UnavailableError as reason:
        pytest.skip(str(reason))
    assert rows
    assert len({row.name for row in rows}) == len(rows)
    for row in rows:
        assert math.isfinite(row.value) and (row.value > 0 or row.unit == "MiB"), row
        assert row.ratio is None or row.ratio > 0, row
        assert (row.ratio is None) == (not row.reference), row
        assert (row.holds is None) == (not row.goal), row
    json.dumps(rows, allow_nan=False)
