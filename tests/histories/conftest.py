"""The checker, built once, and the seed of a run, which ``--seed`` sets."""

import random

import pytest

from histories.checking import Checker, build


@pytest.fixture(scope="session")
def checker(tmp_path_factory: pytest.TempPathFactory) -> Checker:
    return Checker(build(tmp_path_factory.mktemp("checker")))


@pytest.fixture
def seed(request: pytest.FixtureRequest) -> int:
    """Return a new seed in each run without ``--seed``. It is printed if the test fails."""
    found = int(request.config.getoption("--seed")) or random.randrange(1, 10**9)
    print(f"--seed {found}")
    return found
