"""The life of an invocation: progress, unknown outcomes, deadlines, and retention."""

from typing import Any, Literal

import msgspec
import pytest

from linked_fleet_agent.wire.messages import WIRE_VERSION, Progress
from linked_fleet_state.invocations import FLEET, MAX_TERMINAL, Invocation, Invocations, InvocationState

ACTION = "/r/elbow/actions/rotate"


STOP = "/actions/stop"
State = Literal["running", "succeeded", "failed", "cancelled", "preempted"]


def invocation(id: str = "i", state: InvocationState = InvocationState.ACCEPTED, **fields: Any) -> Invocation:
    given = {"robot": "r", "action": ACTION, "targets": {"elbow": 1.0}, "created_ns": 1, "deadline_ns": 100}
    return Invocation(**{"id": id, "state": state, **given, **fields})


def of_fleet(*robots: str) -> Invocation:
    return invocation(robot=FLEET, action=STOP, targets={}, robots=dict.fromkeys(robots, "accepted"))


def progress(state: State, id: str = "i", wall_ns: int = 10, **fields: Any) -> Progress:
    given = {"version": WIRE_VERSION, "incarnation": 1, "reason": "why", "positions": {"elbow": 0.9}}
    return Progress(**{**given, "id": id, "state": state, "wall_ns": wall_ns, **fields})


def with_one(state: InvocationState = InvocationState.ACCEPTED) -> Invocations:
    invocations = Invocations()
    invocations.add(invocation(state=state))
    return invocations


@pytest.mark.parametrize("start", [InvocationState.ACCEPTED, InvocationState.UNKNOWN])
def test_progress_leads_to_the_end(start: InvocationState) -> None:
    invocations = with_one(start)
    running = invocations.apply("r", progress("running"))
    assert running is not None
    assert (running.state, running.started_ns, running.ended_ns) == (InvocationState.RUNNING, 10, None)
    done = invocations.apply("r", progress("succeeded", wall_ns=20))
    assert done is running
    assert (done.state, done.started_ns, done.ended_ns) == (InvocationState.SUCCEEDED, 10, 20)
    assert (done.result, done.reason) == ({"elbow": 0.9}, "why")


def test_a_cancelled_one_is_over_and_a_preempted_one_names_what_came_after() -> None:
    invocations = with_one()
    invocations.add(invocation("j"))
    half = invocations.apply("r", progress("running", progress=0.5))
    assert half is not None
    assert (half.progress, half.preempted_by) == (0.5, "")
    preempted = invocations.apply("r", progress("preempted", progress=0.6, successor="j"))
    assert preempted is half
    assert (half.state, half.progress, half.preempted_by) == (InvocationState.PREEMPTED, 0.6, "j")
    cancelled = invocations.apply("r", progress("cancelled", id="j"))
    assert cancelled is not None
    assert (cancelled.state, cancelled.ended_ns) == (InvocationState.CANCELLED, 10)
    assert invocations.open_of_robot("r") == []


def test_progress_of_others_and_after_the_end_is_nothing() -> None:
    invocations = with_one()
    assert invocations.apply("x", progress("failed")) is None
    assert invocations.apply("r", progress("failed", id="x")) is None
    assert invocations.apply("r", progress("preempted")) is not None
    assert invocations.apply("r", progress("running")) is None


@pytest.mark.parametrize("state", [InvocationState.ACCEPTED, InvocationState.RUNNING])
def test_open_invocations_of_a_lost_agent_are_unknown_until_reported(state: InvocationState) -> None:
    invocations = with_one(state)
    assert invocations.mark_unknown("x") == []
    (lost,) = invocations.mark_unknown("r")
    assert (lost.state, lost.ended_ns) == (InvocationState.UNKNOWN, None)
    assert state.value in lost.reason
    assert invocations.mark_unknown("r") == []
    assert invocations.apply("r", progress("failed")) is lost
    assert invocations.mark_unknown("r") == []
    assert (lost.state, lost.reason) == (InvocationState.FAILED, "why")


@pytest.mark.parametrize("state", [InvocationState.ACCEPTED, InvocationState.RUNNING, InvocationState.UNKNOWN])
def test_an_invocation_open_after_its_deadline_fails(state: InvocationState) -> None:
    invocations = with_one(state)
    assert invocations.overdue(100) == []
    (late,) = invocations.overdue(101)
    invocations.expire(late, 101)
    assert (late.state, late.ended_ns) == (InvocationState.FAILED, 101)
    assert "deadline" in late.reason
    assert invocations.overdue(102) == []


def test_an_expired_invocation_reopens_when_its_robot_reports_it_as_running() -> None:
    invocations = with_one()
    (one,) = invocations.overdue(101)
    invocations.expire(one, 101)
    assert invocations.open_of_robot("r") == []
    assert invocations.apply("r", progress("running")) is one
    assert (one.state, one.ended_ns, invocations.open_of_robot("r")) == (InvocationState.RUNNING, None, [one])
    invocations.expire(one, 101)
    assert invocations.apply("r", progress("succeeded", wall_ns=7)) is one
    assert (one.state, one.ended_ns, one.is_final) == (InvocationState.SUCCEEDED, 7, True)
    assert invocations.apply("r", progress("running")) is None


def test_invocations_of_an_earlier_run_fail() -> None:
    invocations = Invocations()
    for id, incarnation in (("old", 1), ("present", 2), ("later", 3), ("of nobody knows which", 0)):
        invocations.add(invocation(id, InvocationState.UNKNOWN, incarnation=incarnation))
    invocations.add(invocation("goes on without its agent", InvocationState.UNKNOWN, incarnation=1, resumes=True))
    (old,) = invocations.fail_earlier_runs("r", 2, now_ns=50)
    assert (old.id, old.state, old.ended_ns) == ("old", InvocationState.FAILED, 50)
    assert "started anew" in old.reason
    assert invocations.fail_earlier_runs("r", 2, now_ns=50) == invocations.fail_earlier_runs("x", 9, now_ns=50) == []


def test_invocations_are_listed_newest_first() -> None:
    invocations = Invocations()
    for id in "abc":
        invocations.add(invocation(id))
    assert (
        [one.id for one in invocations.of_action(ACTION)]
        == [one.id for one in invocations.of_robot("r")]
        == ["c", "b", "a"]
    )
    assert invocations.of_action("/r/other") == invocations.of_robot("x") == []


def test_the_newest_is_the_one_created_last_in_whatever_order_they_came() -> None:
    invocations = Invocations()
    for created_ns in (3, 1, 2):
        invocations.put(invocation(str(created_ns), created_ns=created_ns))
    assert [one.id for one in invocations.of_robot("r")] == ["3", "2", "1"]


def test_the_open_ones_of_a_robot_are_those_that_are_not_over_whoever_ended_them() -> None:
    invocations = with_one(InvocationState.UNKNOWN)
    invocations.add(invocation("j"))
    invocations.add(invocation("k", robot="x"))
    assert [one.id for one in invocations.open_of_robot("r")] == ["j", "i"]
    invocations.open_of_robot("r")[0].state = InvocationState.FAILED
    assert [one.id for one in invocations.open_of_robot("r")] == ["i"]
    assert invocations.remove("i") is not None
    assert invocations.open_of_robot("r") == invocations.open_of_robot("nobody") == []
    assert invocations.overdue(101) == [invocations.get("k")]


def test_a_removed_one_is_found_nowhere() -> None:
    invocations = with_one()
    assert invocations.remove("i") is not None
    assert invocations.remove("i") is None
    assert invocations.get("i") is invocations.apply("r", progress("failed")) is None
    assert invocations.of_action(ACTION) == invocations.of_robot("r") == invocations.mark_unknown("r") == []
    invocations.add(invocation())
    assert len(invocations.of_action(ACTION)) == 1


def test_an_id_is_taken_once() -> None:
    with pytest.raises(ValueError, match="exists already"):
        with_one().add(invocation())


def test_the_oldest_that_are_over_are_forgotten_and_the_open_ones_never() -> None:
    invocations = with_one()
    for number in range(MAX_TERMINAL + 5):
        invocations.add(invocation(str(number), InvocationState.SUCCEEDED))
    assert invocations.get("i") is not None
    assert invocations.get("4") is None
    assert invocations.get("5") is not None
    assert len(invocations.of_robot("r")) == MAX_TERMINAL + 1


def test_a_busy_robot_does_not_make_the_others_be_forgotten() -> None:
    invocations = with_one(InvocationState.SUCCEEDED)
    for number in range(MAX_TERMINAL + 5):
        invocations.add(invocation(str(number), InvocationState.SUCCEEDED, robot="busy"))
    assert invocations.get("i") is not None
    assert len(invocations.of_robot("busy")) == len(invocations.of_action(ACTION)) - 1 == MAX_TERMINAL


# Written by another gateway


def test_a_stored_state_updates_the_object_that_is_waited_for() -> None:
    invocations = with_one()
    waited = invocations.get("i")
    other = invocation(state=InvocationState.FAILED, ended_ns=7, reason="It said so.", facts={"residual_m": 0.1})
    assert invocations.put(other) is waited
    assert waited == other
    assert invocations.open_of_robot("r") == []
    assert invocations.put(other) is None  # nothing new
    new = invocation("j", client="192.0.2.7")
    assert invocations.put(new) is invocations.get("j") is new


@pytest.mark.parametrize(
    ("held", "written"),
    [
        (InvocationState.SUCCEEDED, InvocationState.RUNNING),
        (InvocationState.CANCELLED, InvocationState.UNKNOWN),
        (InvocationState.RUNNING, InvocationState.ACCEPTED),
    ],
)
def test_an_older_stored_state_reverts_nothing(held: InvocationState, written: InvocationState) -> None:
    invocations = with_one(held)
    assert invocations.put(invocation(state=written)) is None
    assert invocations.get("i") == invocation(state=held)


def test_an_older_copy_takes_nothing_away_that_is_known() -> None:
    invocations = Invocations()
    held = invocation(state=InvocationState.UNKNOWN, reason="gone", progress=0.6, duration_s=50.0, deadline_ns=900)
    held.preempts = ("a",)
    invocations.add(held)
    assert invocations.put(invocation(state=InvocationState.RUNNING)) is None
    assert invocations.put(invocation()) is None
    assert (held.state, held.progress, held.duration_s, held.deadline_ns) == (InvocationState.UNKNOWN, 0.6, 50.0, 900)
    ended = invocation(state=InvocationState.CANCELLED, ended_ns=9)
    assert invocations.put(ended) is held
    assert (held.state, held.duration_s, held.preempts) == (InvocationState.CANCELLED, 50.0, ("a",))


def test_facts_of_the_requesting_gateway_and_reports_are_merged() -> None:
    invocations = with_one()
    held = invocations.apply("r", progress("running", progress=0.5))
    assert held is not None
    assert invocations.put(invocation(duration_s=50.0, deadline_ns=900, preempts=("a",))) is held
    assert (held.state, held.progress, held.started_ns) == (InvocationState.RUNNING, 0.5, 10)
    assert (held.duration_s, held.deadline_ns, held.preempts) == (50.0, 900, ("a",))


@pytest.mark.parametrize("first", ["held", "found"])
def test_of_two_expiries_the_later_deadline_counts(first: str) -> None:
    """In whichever order they are written."""
    failed = invocation(state=InvocationState.FAILED, expired=True, ended_ns=101)
    again = invocation(state=InvocationState.RUNNING, deadline_ns=900)
    invocations = Invocations()
    for one in (failed, again) if first == "held" else (again, failed):
        invocations.put(one)
    (held,) = invocations.of_robot("r")
    assert (held.state, held.expired, held.deadline_ns) == (InvocationState.RUNNING, False, 900)
    assert invocations.open_of_robot("r") == [held]
    invocations.put(invocation(state=InvocationState.FAILED, expired=True, ended_ns=901, deadline_ns=900))
    assert invocations.open_of_robot("r") == []
    invocations.put(invocation(state=InvocationState.SUCCEEDED))
    assert (held.state, held.is_final) == (InvocationState.SUCCEEDED, True)


def test_the_answers_of_robots_that_either_copy_has_are_known() -> None:
    invocations = Invocations()
    one = of_fleet("a", "b", "c")
    invocations.add(one)
    invocations.apply("a", progress("succeeded", reason=""))
    other = of_fleet("a", "b", "c")
    other.robots |= {"b": "unknown: no answer", "c": "refused: no"}
    assert invocations.put(other) is one
    assert one.robots == {"a": "succeeded", "b": "unknown: no answer", "c": "refused: no"}
    assert (one.state, one.progress) == (InvocationState.UNKNOWN, pytest.approx(2 / 3))
    assert invocations.put(of_fleet("a", "b", "c")) is None


# Last commanded positions of joints


def moved(created_ns: int, state: InvocationState, **fields: Any) -> Invocation:
    """Return an accepted motion of the present run."""
    given = {"targets": {"elbow": float(created_ns)}, "duration_s": 1.0, "incarnation": 1}
    return invocation(str(created_ns), state, created_ns=created_ns, **{**given, **fields})


def stopped(created_ns: int, *joints: str, **fields: Any) -> Invocation:
    return moved(created_ns, InvocationState.SUCCEEDED, targets={}, stops=joints, **fields)


UNASKED = {"duration_s": None}
RUNNING, SUCCEEDED, FAILED = InvocationState.RUNNING, InvocationState.SUCCEEDED, InvocationState.FAILED


@pytest.mark.parametrize(
    ("known", "elbow"),
    [
        ([moved(1, SUCCEEDED), moved(2, RUNNING)], 2.0),
        ([moved(2, RUNNING), moved(1, SUCCEEDED)], 2.0),
        ([moved(1, SUCCEEDED), moved(2, RUNNING, targets={"wrist": 2.0})], 1.0),
        ([moved(1, SUCCEEDED), moved(2, FAILED, **UNASKED)], 1.0),
        ([moved(1, SUCCEEDED), moved(2, InvocationState.ACCEPTED, **UNASKED)], 1.0),
        ([moved(1, SUCCEEDED), moved(2, InvocationState.CANCELLED)], None),
        ([moved(1, SUCCEEDED), stopped(2)], None),
        ([moved(1, SUCCEEDED), stopped(2, "elbow")], None),
        ([moved(1, SUCCEEDED), stopped(2, "wrist")], 1.0),
        ([moved(1, SUCCEEDED), stopped(2, **UNASKED)], 1.0),
        ([moved(1, SUCCEEDED), stopped(2, robot="x")], 1.0),
        ([stopped(1), moved(2, SUCCEEDED)], 2.0),
        ([moved(1, SUCCEEDED, incarnation=7)], None),
        ([moved(1, SUCCEEDED), stopped(2, robot=FLEET, incarnation=0, robots={"r": "running"})], None),
        ([moved(1, SUCCEEDED), stopped(2, robot=FLEET, incarnation=0, robots={"r": "unknown: no answer"})], 1.0),
        ([moved(1, RUNNING), moved(2, InvocationState.PREEMPTED, preempted_by="1")], 1.0),
        ([moved(1, InvocationState.PREEMPTED, preempted_by="2"), moved(2, RUNNING, targets={"wrist": 2.0})], None),
    ],
)
def test_the_target_of_a_joint_is_that_of_the_last_motion_that_was_not_stopped(
    known: list[Invocation], elbow: float | None
) -> None:
    invocations = Invocations()
    for one in known:
        invocations.add(one)
    assert invocations.targets("r", 1).get("elbow") == elbow


def test_removing_a_later_invocation_does_not_restore_an_older_target() -> None:
    for after in (moved(2, RUNNING), stopped(2), stopped(2, "elbow")):
        invocations = Invocations()
        invocations.add(moved(1, SUCCEEDED, targets={"elbow": 1.0, "wrist": 1.0}))
        invocations.add(after)
        invocations.remove("2")
        assert invocations.targets("r", 1).get("elbow") is None
        assert invocations.targets("r", 1).get("wrist") == (1.0 if after.targets or after.stops else None)


def test_an_id_does_not_move_to_another_robot() -> None:
    invocations = with_one()
    assert invocations.put(invocation(robot="x")) is None
    assert invocations.of_robot("x") == []


def test_one_is_read_from_json_as_it_was_written_and_what_is_unknown_is_skipped() -> None:
    whole = invocation(
        state=InvocationState.PREEMPTED, client="später \0", body="<a> <b> \"c\" .\n", duration_s=0.25, started_ns=1,
        ended_ns=1_764_000_000_123_456_789, reason="x", progress=0.5, result={"elbow": -0.0}, preempts=("a", "b"),
        preempted_by="c", lease="d", facts={"residual_m": 1e-300}, robots={"r": "failed: x"}, stops=("a",),
        incarnation=2**63 - 1, refused="stale", expired=True,
    )  # fmt: skip
    text = msgspec.json.encode(whole)
    assert msgspec.json.decode(text, type=Invocation) == whole
    assert msgspec.json.decode(text[:-1] + b',"later":1}', type=Invocation) == whole


# Invocations of the whole fleet


def test_the_fleet_has_succeeded_when_every_robot_has() -> None:
    invocations = Invocations()
    invocations.add(of_fleet("a", "b"))
    assert invocations.apply("c", progress("succeeded")) is None
    one = invocations.apply("a", progress("succeeded", reason="", wall_ns=10))
    assert one is not None
    assert (one.state, one.progress, one.started_ns, one.ended_ns) == (InvocationState.RUNNING, 0.5, 10, None)
    assert one.robots == {"a": "succeeded", "b": "accepted"}
    assert invocations.apply("a", progress("failed")) is None  # its part is over
    assert invocations.apply("b", progress("running", wall_ns=20)) is one
    assert invocations.apply("b", progress("succeeded", reason="", wall_ns=30)) is one
    assert (one.state, one.progress, one.started_ns, one.ended_ns) == (InvocationState.SUCCEEDED, 1.0, 10, 30)
    assert one.reason == ""
    assert invocations.apply("b", progress("failed")) is None
    assert one.robots == {"a": "succeeded", "b": "succeeded"}


@pytest.mark.parametrize(
    ("first", "last", "whole"),
    [
        ("failed", "succeeded", InvocationState.FAILED),
        ("failed", "preempted", InvocationState.FAILED),
        ("preempted", "cancelled", InvocationState.PREEMPTED),
        ("succeeded", "cancelled", InvocationState.CANCELLED),
    ],
)
def test_the_fleet_ends_as_the_robot_that_fared_worst(first: State, last: State, whole: InvocationState) -> None:
    invocations = Invocations()
    invocations.add(of_fleet("a", "b"))
    invocations.apply("a", progress(first))
    one = invocations.apply("b", progress(last, reason=""))
    assert one is not None
    assert (one.state, one.reason) == (whole, f"1 of 2 robots: {whole}")
    assert one.robots == {"a": f"{first}: why", "b": last}


def test_a_robot_that_refused_has_failed_and_one_that_has_not_answered_is_waited_for() -> None:
    invocations = Invocations()
    one = of_fleet("a")
    one.robots |= {"b": "refused: not now", "c": "no answer"}
    invocations.add(one)
    invocations.apply("a", progress("succeeded"))
    assert one.state is InvocationState.RUNNING
    assert invocations.apply("b", progress("succeeded")) is None
    invocations.apply("c", progress("succeeded"))
    assert one.state is InvocationState.FAILED


def test_the_fleet_is_unknown_when_all_that_is_open_is() -> None:
    invocations = Invocations()
    one = of_fleet("a", "b")
    invocations.add(one)
    assert invocations.mark_unknown("c") == []
    assert invocations.mark_unknown("a") == [one]
    assert one.state is InvocationState.ACCEPTED
    assert one.robots["a"].startswith("unknown: the agent is gone")
    assert invocations.mark_unknown("a") == []
    invocations.apply("b", progress("succeeded"))
    assert one.state is InvocationState.UNKNOWN
    invocations.apply("a", progress("running"))
    assert one.state is InvocationState.RUNNING
    assert invocations.overdue(101) == [one]
    invocations.expire(one, 101)
    assert one.state is InvocationState.FAILED
