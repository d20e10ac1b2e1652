"""Open motions counted by client, including those that are just beginning."""

from linked_fleet_agent.wire.messages import WIRE_VERSION, Progress
from linked_fleet_gateway.actions.refusals import MotionQuota
from linked_fleet_state.invocations import Invocation, Invocations, InvocationState


def _one(id: str, client: str = "ada", stops: tuple[str, ...] | None = None) -> Invocation:
    return Invocation(id, "r", "/r/actions/x", {}, 1, 100, client=client, stops=stops)


def _running(id: str) -> Progress:
    return Progress(version=WIRE_VERSION, id=id, incarnation=1, state="running", wall_ns=10)


def test_motions_count_while_they_are_open_and_halts_never() -> None:
    known = Invocations()
    quota = MotionQuota(known, 2)
    known.add(_one("a"))
    known.add(_one("halt", stops=()))
    known.add(_one("of another", client="bob"))
    assert not quota.is_exhausted("ada")
    second = _one("b")
    known.add(second)
    assert quota.is_exhausted("ada") and not quota.is_exhausted("bob")
    second.state = InvocationState.SUCCEEDED
    assert not quota.is_exhausted("ada")
    second.state, second.expired = InvocationState.FAILED, True  # a guess
    assert known.apply("r", _running("b")) is second
    assert quota.is_exhausted("ada")
    known.remove("a")
    assert not quota.is_exhausted("ada")


def test_concurrent_starts_do_not_exceed_the_quota() -> None:
    quota = MotionQuota(Invocations(), 2)
    with quota.count_start("ada") as first, quota.count_start("ada") as second, quota.count_start("ada") as third:
        assert (first, second, third) == (False, False, True)
        assert not quota.is_exhausted("bob")
    assert not quota.is_exhausted("ada")
