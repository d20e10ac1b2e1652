"""Long histories: of real gateways over HTTP, and of many more in one process, under the same faults and
while a replica takes the place of its master again and again."""

from collections.abc import Callable
from pathlib import Path

import pytest
from histories.checking import Checker
from histories.history import History
from histories.runs import of_processes, on_promoted_servers

pytestmark = [pytest.mark.processes, pytest.mark.test_all]
OF_PROCESSES, IN_ONE_PROCESS = 4_000, 100_000


@pytest.mark.parametrize(
    ("run", "operations"), [(of_processes, OF_PROCESSES), (on_promoted_servers, IN_ONE_PROCESS)], ids=["http", "stores"]
)
def test_thousands_of_operations(
    checker: Checker, tmp_path: Path, seed: int, run: Callable[[Path, int, int], History], operations: int
) -> None:
    history = run(tmp_path, seed, operations)
    verdict = checker.check(history)
    print(verdict)
    assert verdict.accepted, f"HISTORIES_SEED={seed}\n{verdict}"
    assert sum(verdict.operations.values()) >= operations
    assert set(verdict.operations) == {"register", "lease", "key", "command", "subscription", "callback"}
