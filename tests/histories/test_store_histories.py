"""Thousands of operations of many clients on three gateways and one server, under faults, are linearizable."""

from pathlib import Path

from histories.checking import Checker
from histories.runs import on_one_server

OPERATIONS = 5_000


def test_five_thousand_operations(checker: Checker, tmp_path: Path, seed: int) -> None:
    history = on_one_server(tmp_path, seed, OPERATIONS)
    verdict = checker.check(history)
    print(verdict)
    assert verdict.accepted, f"HISTORIES_SEED={seed}\n{verdict}"
    assert sum(verdict.operations.values()) >= OPERATIONS
    assert set(verdict.operations) == {"register", "lease", "key", "command", "subscription", "callback"}
