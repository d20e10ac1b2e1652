"""When an agent repeats its Zenoh declarations, on the test's own clock."""

from itertools import pairwise

import pytest

from linked_fleet_agent.gateways import FORGOTTEN_S, LONGEST_S, MAX_MISSING, RENEW_S, Renewal

PERIOD_S = 0.25


class Robot:
    """An agent that ticks; ``alive``: whether any gateway is alive."""

    def __init__(self) -> None:
        self.now_s = 1000.0
        self.renewal, self.alive = Renewal(self.now_s), False

    def appear(self, name: str = "g") -> None:
        self.renewal.record_arrival(name, self.now_s)
        self.alive = True

    def lose(self, name: str = "g", alive: bool = False) -> None:
        self.renewal.record_departure(name, self.now_s)
        self.alive = alive

    def run(self, seconds: float) -> list[float]:
        """Return the seconds after which declarations were repeated."""
        began_s, due = self.now_s, []
        while self.now_s < began_s + seconds:
            self.now_s += PERIOD_S
            if self.renewal.due(self.now_s, self.alive):
                due.append(self.now_s - began_s)
        return due


def test_with_a_gateway_from_the_beginning_nothing_is_due() -> None:
    robot = Robot()
    robot.run(1.0)
    robot.appear()
    robot.appear("another")
    assert robot.run(2 * FORGOTTEN_S) == []


def test_once_after_a_gateway_has_gone_and_come_back() -> None:
    """It waits for a second connection that breaks."""
    robot = Robot()
    robot.appear()
    robot.run(60.0)
    robot.lose()
    assert robot.run(1.0) == []
    robot.appear()
    robot.run(1.0)
    robot.lose()
    robot.appear()
    assert robot.run(FORGOTTEN_S) == [RENEW_S]


def test_again_and_again_while_a_gateway_is_missing_though_another_is_alive() -> None:
    robot = Robot()
    robot.appear()
    robot.appear("another")
    robot.run(60.0)
    robot.lose(alive=True)
    due = robot.run(2 * FORGOTTEN_S)
    assert due[:6] == [5.0, 15.0, 35.0, 75.0, 135.0, 195.0]
    assert max(after - before for before, after in pairwise(due)) == LONGEST_S
    assert FORGOTTEN_S <= due[-1] <= FORGOTTEN_S + LONGEST_S


def test_declarations_are_renewed_while_no_gateway_is_alive_and_once_after() -> None:
    robot = Robot()
    due = robot.run(2 * FORGOTTEN_S)
    assert due[:3] == [2 * RENEW_S, 4 * RENEW_S, 8 * RENEW_S]
    assert due[-1] > 2 * FORGOTTEN_S - LONGEST_S - 1
    robot.appear()
    assert robot.run(FORGOTTEN_S) == [RENEW_S]


@pytest.mark.parametrize("back", [False, True])
def test_a_gateway_that_hangs_is_as_none(back: bool) -> None:
    """Its token stays, but it sends no other messages."""
    robot = Robot()
    robot.appear()
    robot.run(60.0)
    robot.alive = False
    assert robot.run(4.0) == []
    robot.alive = back
    assert len(robot.run(30.0)) == (1 if back else 2)


def test_tokens_of_strangers_cost_no_more_than_some() -> None:
    robot = Robot()
    for number in range(2 * MAX_MISSING):
        robot.lose(str(number))
    assert len(robot.renewal._missing) == MAX_MISSING
