"""Runs that send no frames, on the test's own clock."""

from linked_fleet_state.presence import PERIOD_S, RENEWALS, SILENT_S, PresenceCheck, Run, SilentRuns


class Gateway:
    """Checks the online runs periodically."""

    def __init__(self) -> None:
        self.now_s = 1000.0
        self.runs: dict[str, Run] = {}
        self._silences = SilentRuns()

    def hear(self, robot: str, sequence: int, run: int = 1) -> None:
        self.runs[robot] = Run(robot, run, sequence)

    def check(self, gap_s: float = PERIOD_S) -> list[PresenceCheck]:
        self.now_s += gap_s
        if not self._silences.begin_round(self.now_s):
            return []
        return [check for run in self.runs.values() if (check := self._silences.check(run))]

    def until_asked(self, robot: str = "r") -> float:
        """Return the seconds until a robot is asked."""
        began_s = self.now_s
        while not any(doubt.token[0] == robot for doubt in self.check()):
            assert self.now_s < began_s + 1000.0, "it is never asked"
        return self.now_s - began_s


def test_a_robot_that_sends_is_never_asked() -> None:
    gateway = Gateway()
    for sequence in range(1000):
        gateway.hear("r", sequence)
        assert gateway.check() == []


def test_a_silent_robot_is_asked_and_again_after_times_that_double_up_to_a_minute() -> None:
    gateway = Gateway()
    gateway.hear("r", 7)
    gateway.check()
    assert [gateway.until_asked() for _ in range(7)] == [SILENT_S, 10.0, 20.0, 40.0, 60.0, 60.0, 60.0]


def test_one_that_sent_no_frame_at_all_is_asked_too() -> None:
    gateway = Gateway()
    gateway.hear("r", -1)
    gateway.check()
    assert gateway.until_asked() == SILENT_S


def test_the_first_questions_of_a_silence_are_worth_declarations_of_the_gateway() -> None:
    gateway = Gateway()
    for silence in range(2):
        gateway.hear("r", silence)
        asked = [doubt for _ in range(300) for doubt in gateway.check()]
        assert [doubt.renew for doubt in asked] == RENEWALS * [True] + (len(asked) - RENEWALS) * [False]
        assert {doubt.token for doubt in asked} == {("r", 1)}


def test_another_run_or_a_frame_ends_a_silence() -> None:
    gateway = Gateway()
    for run, sequence in ((1, 7), (1, 8), (2, 8)):
        gateway.hear("r", sequence, run)
        for _ in range(round(SILENT_S / PERIOD_S)):
            assert gateway.check() == []
    assert gateway.check() == [PresenceCheck(("r", 2), renew=True)]


def test_one_that_was_offline_is_silent_from_its_return() -> None:
    gateway = Gateway()
    gateway.hear("r", 7)
    gateway.check()
    gateway.until_asked()
    gateway.runs.clear()
    gateway.check()
    gateway.hear("r", 7)
    gateway.check()
    assert gateway.until_asked() == SILENT_S


def test_frames_missed_while_the_gateway_was_paused_are_no_silence() -> None:
    gateway = Gateway()
    gateway.hear("r", 7)
    gateway.check()
    assert gateway.check(gap_s=3600.0) == []
    assert gateway.until_asked() == SILENT_S - 2 * PERIOD_S


def test_frequent_calls_change_nothing() -> None:
    gateway = Gateway()
    gateway.hear("r", 7)
    asked = [doubt for _ in range(100) for doubt in gateway.check(gap_s=PERIOD_S / 4)]
    assert asked == 2 * [PresenceCheck(("r", 1), renew=True)]  # after 5 and after 15 of 25 s
