"""Progress of runs: every order of events gives what a plain interpreter gives, and nothing begins twice. Pure."""

from collections.abc import Mapping

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from linked_fleet_gateway.extensions.missions.mission import (
    FirstOf,
    Invoke,
    Mission,
    Notify,
    Parallel,
    Repeat,
    Sequence,
    Step,
    Wait,
)
from linked_fleet_gateway.extensions.missions.progress import due_ns, ending, retried, settle, skipped, with_step
from linked_fleet_gateway.extensions.missions.record import ENDED, OVER, Creator, Run, StepState

NOW_NS = 1_000_000_000_000


def run_of(step: Step, *, holds: bool = False) -> Run:
    return Run(Mission("m", step, holds=holds), "/missions/1", "http://a", {}, Creator(), NOW_NS)


def invoke(name: str = "") -> Invoke:
    return Invoke(action="http://a/r/actions/x", name=name)


def ended(run: Run, path: str, state: StepState) -> Run:
    return with_step(run, path, replace(run.steps[path], state=state, ended_ns=NOW_NS))


def open_paths(run: Run) -> list[str]:
    return [path for path, each in run.steps.items() if each.state not in ENDED]


def test_waits_end_when_they_are_due_and_conditions_fail_then() -> None:
    steps = (Wait(seconds=2.0), Wait(condition="SELECT ?a WHERE { ?a ?b ?c }", within=5.0))
    run, _ = settle(run_of(Sequence(steps)), NOW_NS)
    assert open_paths(run) == ["0.0"]
    run, _ = settle(run, NOW_NS + 2_000_000_000)
    assert open_paths(run) == ["0.1"]
    run, _ = settle(run, NOW_NS + 8_000_000_000)
    assert (run.phase, run.reason) == ("failed", "the condition had no answer within 5 s")


@pytest.mark.parametrize(
    ("until", "seconds"),
    [("1970-01-01T00:20:00Z", 1200), ("1970-01-01T02:20:00+02:00", 1200), ("1970-01-01T00:20:00", 1200)],
)
def test_instants_have_time_zones(until: str, seconds: int) -> None:
    assert due_ns(Wait(until=until), NOW_NS) == seconds * 1_000_000_000


def test_a_paused_run_begins_nothing() -> None:
    run, _ = settle(run_of(Sequence((invoke(), invoke()))), NOW_NS)
    run = ended(replace(run, phase="paused"), "0.0", "succeeded")
    run, _ = settle(run, NOW_NS)
    assert list(run.steps) == ["0.0"]
    run, _ = settle(replace(run, phase="running"), NOW_NS)
    assert open_paths(run) == ["0.1"]


def test_an_ending_run_is_over_once_nothing_runs_and_does_not_wait_for_what_is_unknown() -> None:
    run, _ = settle(run_of(Parallel((invoke(), invoke()))), NOW_NS)
    run, cancel = settle(ending(run, "cancelled", "why"), NOW_NS)
    assert cancel == ["0.0", "0.1"]
    run = with_step(run, "0.0", replace(run.steps["0.0"], state="unknown"))
    run, _ = settle(ended(run, "0.1", "cancelled"), NOW_NS)
    assert (run.phase, run.reason) == ("cancelled", "why")


def test_retry_takes_a_step_and_what_was_cancelled_because_of_it_again() -> None:
    run, _ = settle(run_of(Parallel((invoke(), invoke(), invoke())), holds=True), NOW_NS)
    run = ended(ended(run, "0.2", "succeeded"), "0.0", "failed")
    run, cancel = settle(run, NOW_NS)
    assert cancel == ["0.1"]
    run, _ = settle(ended(run, "0.1", "cancelled"), NOW_NS)
    assert run.phase == "blocked"
    again, _ = settle(retried(run, "0.0", NOW_NS), NOW_NS)
    assert {path: (each.state, each.attempt) for path, each in again.steps.items()} == {
        "0.0": ("starting", 2), "0.1": ("starting", 2), "0.2": ("succeeded", 1)
    }  # fmt: skip
    passed, _ = settle(skipped(run, "0.0", NOW_NS), NOW_NS)
    assert open_paths(passed) == ["0.1"]


def test_rounds_keep_the_steps_of_the_last_one() -> None:
    run, _ = settle(run_of(Repeat(Sequence((invoke("a"), Notify(text="n"))), times=3)), NOW_NS)
    for number in range(3):
        assert open_paths(run) == [f"0.0#{number}.0"]
        run, _ = settle(ended(run, f"0.0#{number}.0", "succeeded"), NOW_NS)
    assert run.phase == "succeeded"
    assert list(run.steps) == ["0.0#2.0", "0.0#2.1"]
    assert len(run.notes) == 3


# -- every order of events --------------------------------------------------------------------------------------------

LEAF = st.just(None)
TREES = st.recursive(
    LEAF,
    lambda inner: st.one_of(
        st.tuples(st.sampled_from(["sequence", "firstOf", "all", "any"]), st.lists(inner, min_size=1, max_size=3)),
        st.tuples(st.just("repeat"), st.tuples(inner, st.integers(1, 3))),
    ),
    max_leaves=10,
)


def built(tree: object) -> Step:
    if tree is None:
        return invoke()
    assert isinstance(tree, tuple)
    kind, said = tree
    if kind == "repeat":
        return Repeat(built(said[0]), times=said[1])
    steps = tuple(built(each) for each in said)
    if kind == "sequence":
        return Sequence(steps)
    return FirstOf(steps) if kind == "firstOf" else Parallel(steps, anySuffices=kind == "any")


def succeeds(step: Step, path: str, good: Mapping[str, bool]) -> bool:
    """Return what a plain interpreter returns: ``good`` has the outcomes of leaves by path, True if there is none."""
    match step:
        case Sequence():
            return all(succeeds(each, f"{path}.{n}", good) for n, each in enumerate(step.steps))
        case FirstOf():
            return any(succeeds(each, f"{path}.{n}", good) for n, each in enumerate(step.steps))
        case Parallel():
            found = [succeeds(each, f"{path}.{n}", good) for n, each in enumerate(step.steps)]
            return any(found) if step.anySuffices else all(found)
        case Repeat():
            return all(succeeds(step.step, f"{path}.0#{n}", good) for n in range(step.times))
    return good.get(path, True)


@pytest.mark.hypothesis
@given(TREES, st.data())
def test_every_order_of_ends_gives_the_outcome_of_a_plain_interpreter(tree: object, data: st.DataObject) -> None:
    """At each event the record may pass to another gateway: it is encoded and decoded."""
    step = built(tree)
    run, _ = settle(run_of(step), NOW_NS)
    good, begun = dict[str, bool](), set[str]()
    for _ in range(2000):
        if run.phase in OVER:
            break
        run = msgspec.json.decode(msgspec.json.encode(run), type=Run)
        assert not begun.intersection(run.steps.keys() - begun) and open_paths(run)
        begun |= run.steps.keys()
        path = data.draw(st.sampled_from(open_paths(run)))
        _, cancel = settle(run, NOW_NS)
        if path in cancel:
            run, _ = settle(ended(run, path, "cancelled"), NOW_NS)
            continue
        good[path] = data.draw(st.booleans())
        run, _ = settle(ended(run, path, "succeeded" if good[path] else "failed"), NOW_NS)
    assert run.phase == ("succeeded" if succeeds(step, "0", good) else "failed")
