"""Targets found by the index equal those found by scanning everything."""

from hypothesis import given, settings
from hypothesis import strategies as st

from linked_fleet_state.invocation import FLEET, Invocation, InvocationState, reported_state
from linked_fleet_state.invocations import Invocations, joints_of
from properties import examples

_TOOK = ("accepted", "running", "succeeded", "failed", "cancelled", "preempted")
_JOINTS = ("elbow", "wrist")


class UnindexedTargets:
    """Computes targets by their definition, without an index."""

    def __init__(self) -> None:
        self.all: dict[str, Invocation] = {}
        self.removed: list[Invocation] = []

    def targets(self, run: int) -> dict[str, float]:
        found = {}
        for joint in _JOINTS:
            motions = [one for one in self.all.values() if self._moves(one, run, joint)]
            last = max(motions, key=lambda one: one.created_ns, default=None)
            stops = [one for one in self.all.values() if one.stops is not None and _stopped(one, run)]
            ends = [one.created_ns for one in (*stops, *self.removed) if {joint, ""} & set(joints_of(one))]
            if last is None or (last.state.terminal and last.state is not InvocationState.SUCCEEDED):
                continue
            if last.created_ns > max(ends, default=0):
                found[joint] = last.targets[joint]
        return found

    def _moves(self, one: Invocation, run: int, joint: str) -> bool:
        if one.stops is not None or joint not in one.targets or one.incarnation != run or not one.accepted:
            return False
        after = self.all.get(one.preempted_by)
        return after is None or after.stops is not None or joint not in after.targets


def _stopped(one: Invocation, run: int) -> bool:
    if one.robot == FLEET:
        return reported_state(one.robots.get("r", "")) in _TOOK
    return one.incarnation == run and one.accepted


@st.composite
def _invocations(draw: st.DrawFn, id: int) -> Invocation:
    fleet = draw(st.booleans()) and draw(st.booleans())
    stops = () if fleet else draw(st.none() | st.sampled_from([(), ("elbow",), ("wrist",)]))
    joints = draw(st.sampled_from([("elbow",), ("wrist",), _JOINTS])) if stops is None else ()
    return Invocation(
        id=str(id),
        robot=FLEET if fleet else "r",
        action="/r/actions/x",
        targets={joint: float(id) for joint in joints},
        created_ns=draw(st.integers(1, 30)),
        deadline_ns=100,
        duration_s=draw(st.none() | st.just(1.0)),
        state=draw(st.sampled_from(InvocationState)),
        preempted_by=draw(st.sampled_from(["", "", "0", "1", "2", "3"])),
        robots={"r": draw(st.sampled_from(["succeeded", "unknown: no answer", "refused: no"]))} if fleet else {},
        stops=stops,
        incarnation=0 if fleet else draw(st.integers(1, 2)),
    )


@settings(max_examples=examples(300))
@given(data=st.data())
def test_an_index_finds_what_a_look_through_all_finds(data: st.DataObject) -> None:
    invocations, plainly = Invocations(), UnindexedTargets()
    for id in range(data.draw(st.integers(1, 8))):
        one = data.draw(_invocations(id))
        if any(other.created_ns == one.created_ns for other in plainly.all.values()):
            continue  # of two at the same moment either may be the last
        invocations.add(one)
        plainly.all[one.id] = one
        if data.draw(st.integers(0, 3)) == 0:
            gone = data.draw(st.sampled_from(sorted(plainly.all)))
            invocations.remove(gone)
            removed = plainly.all.pop(gone)
            plainly.removed += [removed] if removed.accepted and removed.robot != FLEET else []
        for run in (1, 2):
            assert invocations.targets("r", run) == plainly.targets(run)
