"""Thousands of operations of many clients on several gateways, under faults, are linearizable.

The long histories are those of gateways over HTTP, and of a replica that repeatedly replaces its master.
"""

from collections.abc import Callable
from pathlib import Path

import pytest

from histories.checking import Checker
from histories.history import History
from histories.runs import of_processes, on_one_server, on_promoted_servers
from properties import ALL

pytestmark = pytest.mark.test_all  # needs Go


@pytest.mark.parametrize(
    ("run", "operations"),
    [
        pytest.param(on_one_server, 5_000, id="one server"),
        pytest.param(of_processes, 4_000, id="http", marks=pytest.mark.processes),
        pytest.param(on_promoted_servers, 100_000 if ALL else 40_000, id="stores", marks=pytest.mark.processes),
    ],
)
def test_thousands_of_operations(
    checker: Checker, tmp_path: Path, seed: int, run: Callable[[Path, int, int], History], operations: int
) -> None:
    history = run(tmp_path, seed, operations)
    verdict = checker.check(history)
    print(verdict)
    assert verdict.accepted, f"--seed {seed}\n{verdict}"
    assert sum(verdict.operations.values()) >= operations
    assert set(verdict.operations) == {"register", "lease", "key", "command", "subscription", "callback"}
