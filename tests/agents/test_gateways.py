"""Which gateways an agent considers alive, on the test's own clock without real gateways."""

import pytest

from linked_fleet_agent.gateways import GRACE_S, LEASE_S, MAX_GATEWAYS, PAUSE_S, Gateways
from linked_fleet_agent.wire.transport import HEARTBEAT_S

PERIOD_S = 0.01


class Robot:
    """A robot whose event loop ticks every ``PERIOD_S``, and gateways that send heartbeats."""

    def __init__(self) -> None:
        self.now_s = 1000.0
        self.gateways = Gateways("r")
        self.gateways.watch(self.now_s, PERIOD_S)

    def appear(self, name: str = "g") -> None:
        self.gateways.record_arrival(name, self.now_s)

    def lose(self, name: str = "g") -> None:
        self.gateways.record_departure(name, self.now_s)

    def hear(self, name: str = "g") -> None:
        self.gateways.record_heartbeat(name, self.now_s)

    def run(self, seconds: float, *beating: str) -> None:
        """Tick for so long while the named gateways send heartbeats; each sends a last one at the end."""
        for tick in range(1, round(seconds / PERIOD_S) + 1):
            self.tick()
            if tick % round(HEARTBEAT_S / PERIOD_S) == 0:
                for name in beating:
                    self.hear(name)

    def tick(self, gap_s: float = PERIOD_S) -> None:
        self.now_s += gap_s
        self.gateways.watch(self.now_s, PERIOD_S)

    @property
    def holds(self) -> bool:
        return not self.gateways.present

    def runs_until_it_holds(self) -> float:
        """Return the time until it holds."""
        start_s = self.now_s
        while not self.holds:
            assert self.now_s - start_s < 60.0, "it never holds"
            self.tick()
        return self.now_s - start_s


def test_without_any_gateway_the_robot_holds() -> None:
    assert Robot().holds


def test_a_gateway_is_alive_while_it_sends_heartbeats() -> None:
    robot = Robot()
    robot.appear()
    assert not robot.holds
    robot.run(60.0, "g")
    assert not robot.holds
    assert robot.gateways.arrivals == 1


def test_a_gateway_whose_token_stays_and_whose_heartbeat_stops_is_gone_within_the_lease(
    caplog: pytest.LogCaptureFixture,
) -> None:
    """An event loop may hang while Zenoh's threads keep the token."""
    robot = Robot()
    robot.appear()
    robot.run(10.0, "g")
    assert robot.runs_until_it_holds() == pytest.approx(LEASE_S, abs=2 * PERIOD_S)
    assert "gateway g sent no heartbeat for 2.5 s" in caplog.text


def test_a_gateway_that_goes_on_is_there_again_and_counts_as_one_that_has_come() -> None:
    """Ends of motions during the hang are repeated to it."""
    robot = Robot()
    robot.appear()
    robot.runs_until_it_holds()
    robot.hear()
    assert not robot.holds
    assert robot.gateways.arrivals == 2
    robot.run(10.0, "g")
    assert not robot.holds


def test_a_gateway_that_never_sends_a_heartbeat_counts_for_one_lease(caplog: pytest.LogCaptureFixture) -> None:
    """Either it hangs when the agent starts, or its version has no heartbeats, which the log reports."""
    robot = Robot()
    robot.appear()
    assert robot.runs_until_it_holds() == pytest.approx(LEASE_S, abs=2 * PERIOD_S)
    assert "its version sends none" in caplog.text


def test_a_heartbeat_without_a_token_is_nobodys() -> None:
    robot = Robot()
    robot.hear()
    robot.run(1.0, "g")
    assert robot.holds


def test_the_robot_holds_when_none_of_several_is_left() -> None:
    robot = Robot()
    robot.appear("a")
    robot.appear("b")
    robot.run(10.0, "b")
    assert not robot.holds
    robot.lose("b")
    assert robot.runs_until_it_holds() == pytest.approx(GRACE_S, abs=2 * PERIOD_S)


def test_a_gateway_whose_token_is_gone_has_a_moment_to_connect_again() -> None:
    """A connection that is closed and opened again is no gap; one that is not opened again is."""
    robot = Robot()
    robot.appear()
    robot.run(10.0, "g")
    robot.lose()
    robot.run(GRACE_S / 2)
    robot.appear()
    robot.run(10.0, "g")
    assert not robot.holds
    robot.lose()
    assert robot.runs_until_it_holds() == pytest.approx(GRACE_S, abs=2 * PERIOD_S)


def test_a_gateway_that_hangs_does_not_live_longer_by_connecting_again() -> None:
    robot = Robot()
    robot.appear()
    robot.run(10.0, "g")
    start_s = robot.now_s
    for _ in range(6):
        robot.run(0.4)
        robot.lose()
        robot.appear()
    robot.runs_until_it_holds()
    assert robot.now_s - start_s == pytest.approx(LEASE_S, abs=2 * PERIOD_S)


@pytest.mark.parametrize("pause_s", [1.0, 3.0, 3600.0])
def test_a_pause_of_the_agent_or_of_the_machine_is_no_gateway_that_is_gone(pause_s: float) -> None:
    """Zenoh closes the connection, before or after the first tick following the pause, and connects again."""
    for ticks_before in (0, 1, 10):
        robot = Robot()
        robot.appear()
        robot.run(10.0, "g")
        robot.run(HEARTBEAT_S - PERIOD_S)
        robot.now_s += pause_s
        robot.run(ticks_before * PERIOD_S)
        robot.lose()
        robot.run(1.0)
        assert not robot.holds
        robot.appear()
        robot.run(10.0, "g")
        assert not robot.holds
        assert robot.gateways.arrivals == 2


@pytest.mark.parametrize("seen", [True, False], ids=["the token goes", "the token stays"])
def test_a_gateway_that_dies_in_a_pause_is_gone_within_its_lease_of_the_time_in_which_the_agent_ran(seen: bool) -> None:
    robot = Robot()
    robot.appear()
    robot.run(10.0, "g")
    robot.run(0.3)
    robot.tick(3600.0)
    if seen:
        robot.lose()
    assert robot.runs_until_it_holds() <= LEASE_S - 0.3 + 2 * PERIOD_S


def test_pause_after_pause_does_not_keep_a_dead_gateway_alive() -> None:
    """Each pause is credited with a limited time, however little the agent runs in between."""
    robot = Robot()
    robot.appear()
    robot.run(10.0, "g")
    ticks = 0
    while not robot.holds:
        robot.tick(3600.0)
        ticks += 1
    assert ticks <= LEASE_S / PAUSE_S + 1


def test_long_after_a_pause_the_loss_of_a_token_counts_as_ever() -> None:
    robot = Robot()
    robot.appear()
    robot.run(1.0, "g")
    robot.tick(5.0)
    robot.run(LEASE_S + 1.0, "g")
    robot.lose()
    assert robot.runs_until_it_holds() == pytest.approx(GRACE_S, abs=2 * PERIOD_S)


def test_a_slow_agent_is_not_taken_for_paused() -> None:
    """An agent that ticks once a second holds within the lease and one tick."""
    gateways = Gateways("r")
    gateways.watch(0.0, 1.0)
    gateways.record_arrival("g", 0.0)
    gateways.watch(1.0, 1.0)
    gateways.watch(2.0, 1.0)
    assert gateways.present
    gateways.watch(3.0, 1.0)
    assert not gateways.present


def test_tokens_of_strangers_cost_bounded_memory() -> None:
    """Gateways that were present before the pause still count."""
    robot = Robot()
    robot.appear()
    for number in range(10 * MAX_GATEWAYS):
        robot.appear(f"stranger {number}")
    assert robot.gateways.arrivals == MAX_GATEWAYS
    robot.run(10.0, "g")
    assert not robot.holds
