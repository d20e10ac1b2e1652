"""Real processes are stopped and continued, as the counterpart of tests on virtual time."""

from pathlib import Path

import pytest

from tests.fleet.test_fault_partition import Scene, scene
from tests.fleet.test_fault_partition import (
    test_a_gateway_that_freezes_is_lost_and_executes_nothing_when_it_goes_on as freezes,
)
from tests.fleet.test_fault_partition import test_commands_during_a_partition_never_run as never_runs
from tests.fleet.test_fault_pause import (
    test_a_robot_goes_on_after_a_pause_shorter_than_the_lease_and_else_holds as pauses,
)
from tests.fleet.test_owed_stops import (
    test_a_robot_that_is_stopped_in_a_long_pause_rests_afterwards as stopped_in_pause,
)

pytestmark = pytest.mark.processes
__all__ = ["scene"]


def test_a_robot_holds_after_a_long_pause_of_the_machine(tmp_path: Path) -> None:
    pauses(tmp_path, whole=True, pause_s=4.0)


def test_a_robot_that_is_stopped_while_its_agent_is_paused_stays_at_rest(tmp_path: Path) -> None:
    stopped_in_pause(tmp_path)


def test_a_gateway_that_freezes_is_lost(scene: Scene) -> None:
    freezes(scene)


@pytest.mark.test_all
def test_commands_to_a_frozen_agent_never_run(scene: Scene) -> None:
    never_runs(scene)
