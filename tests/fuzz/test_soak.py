"""The soak test runs for some seconds; memory is not tested then."""

import pytest

from fuzzing.soak import run

pytestmark = [pytest.mark.processes, pytest.mark.test_all]


def test_the_soak_runs_for_some_seconds() -> None:
    table = run(0.1)
    assert int(table["callbacks that have the latest value"]) > 0
    assert any(what.startswith("faults") for what in table)
