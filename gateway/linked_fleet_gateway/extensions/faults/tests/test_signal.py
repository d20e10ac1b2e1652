"""Debouncing, against a model that keeps the whole history, and the bounds of what one thing may raise."""

from dataclasses import dataclass

from hypothesis import given
from hypothesis import strategies as st

from linked_fleet_gateway.extensions.faults.fault import Trouble
from linked_fleet_gateway.extensions.faults.signal import FLAPS, Policy, Signal, Verdict
from linked_fleet_gateway.extensions.faults.signals import EVENT_KEPT_NS, MOST_OF_ONE, Signals

S = 10**9


@dataclass(frozen=True)
class Stay:
    """A time in which the trouble was there; ``end`` is None while it is."""

    begin: int
    end: int | None


def stays(steps: list[tuple[int, str]]) -> tuple[list[Stay], int]:
    """Return all times of a history in which the trouble was there, and the present time."""
    found, now = list[Stay](), 0
    for wait, what in steps:
        now += wait
        here = bool(found) and found[-1].end is None
        if what == "come" and not here:
            found.append(Stay(now, None))
        elif what == "go" and here:
            found[-1] = Stay(found[-1].begin, now)
    return found, now


def expected(steps: list[tuple[int, str]], policy: Policy) -> tuple[Verdict, int]:
    """Return the verdict and the count of the whole history."""
    found, now = stays(steps)
    appearance = list[Stay]()
    for each in found:
        last = appearance[-1].end if appearance else None
        if last is not None and each.begin - last >= policy.clear_ns:
            appearance = []
        appearance.append(each)
    last = appearance[-1].end if appearance else 0
    if not appearance or (last is not None and now - last >= policy.clear_ns):
        return "absent", 0
    long = any((now if each.end is None else each.end) - each.begin >= policy.confirm_ns for each in appearance)
    return "confirmed" if long or len(appearance) >= FLAPS else "raised", len(appearance)


@given(
    st.lists(st.tuples(st.integers(0, 6), st.sampled_from(("come", "go", "judge"))), max_size=40),
    st.integers(0, 5),
    st.integers(0, 5),
)
def test_a_signal_tells_what_its_history_tells(steps: list[tuple[int, str]], confirm: int, clear: int) -> None:
    policy = Policy(confirm * 1e-9, clear * 1e-9)
    signal, now = Signal(policy), 0
    for number, (wait, what) in enumerate(steps):
        now += wait
        if what == "come":
            signal.come(now)
        elif what == "go":
            signal.go(now)
        verdict, count = expected(steps[: number + 1], policy)
        assert signal.judge(now) == verdict
        if verdict != "absent":
            assert signal.count == count


def test_a_thousand_flaps_are_one_appearance_and_over_after_a_while() -> None:
    signal = Signal(Policy(confirm_s=1, clear_s=3))
    for number in range(1000):
        signal.come(number * 1_000_000)
        signal.go(number * 1_000_000 + 500_000)
    assert (signal.judge(S), signal.count, signal.began_ns) == ("confirmed", 1000, 0)
    assert signal.judge(3 * S) == "confirmed"
    assert signal.judge(5 * S) == "absent"


def trouble(kind: str, **more: bool) -> Trouble:
    return Trouble(kind, "/panda/", ("panda",), **more)


def test_what_a_thing_no_longer_shows_has_gone() -> None:
    signals = Signals(lambda kind: Policy(confirm_s=1, clear_s=1))
    signals.show("panda", [trouble("a"), trouble("b")], 0)
    signals.show("panda", [trouble("b")], 2 * S)
    signals.show("ur5", [trouble("c")], 2 * S)
    verdicts = {sight.trouble.kind: (sight.verdict, sight.present) for _, sight in signals.sights(2 * S)}
    assert verdicts == {"a": ("confirmed", False), "b": ("confirmed", True), "c": ("raised", True)}
    assert dict(signals.sights(4 * S))[trouble("a").id].verdict == "absent"
    assert not signals.has(trouble("a").id), "it is told once"


def test_a_thing_raises_no_more_than_its_bound() -> None:
    signals = Signals(lambda kind: Policy())
    signals.show("panda", (trouble(str(number)) for number in range(10_000)), 0)
    assert len(list(signals.sights(0))) == MOST_OF_ONE
    assert signals.left_out == 1


def test_events_stay_until_they_are_written_and_those_after_remain() -> None:
    signals = Signals(lambda kind: Policy())
    lost = trouble("lost", event=True)
    for number in range(20):
        signals.happen(lost, str(number), number)
    ((id, sight),) = signals.sights(20)
    assert (sight.count, len(sight.events), sight.since_ns, sight.last_ns) == (20, 16, 0, 19)
    signals.happen(lost, "later", 21)
    signals.written(id, sight)
    ((_, sight),) = signals.sights(22)
    assert (sight.count, sight.events) == (1, ("later",))
    signals.forget_old_events(EVENT_KEPT_NS + 22)
    assert not list(signals.sights(22))
