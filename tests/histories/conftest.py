"""The checker, built once, and the seed of a run: HISTORIES_SEED repeats one."""

import os
import random

import pytest
from histories.checking import Checker, build


@pytest.fixture(scope="session")
def checker(tmp_path_factory: pytest.TempPathFactory) -> Checker:
    return Checker(build(tmp_path_factory.mktemp("checker")))


@pytest.fixture
def seed() -> int:
    """Printed, so that a failure shows it."""
    found = int(os.environ.get("HISTORIES_SEED") or random.randrange(10**9))
    print(f"HISTORIES_SEED={found}")
    return found
