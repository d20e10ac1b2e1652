"""Reports that are repeated to a gateway that came later."""

from linked_fleet_agent.motion import Outcome
from linked_fleet_agent.publications import AGAIN_NS, KEPT_NS, Report
from linked_fleet_agent.wire import codec
from linked_fleet_agent.wire.messages import Progress

NOW_NS = 10**12


def report() -> Report:
    """Return a report of one ended and one running motion."""
    told = Report(7)
    for id, state in (("done", "succeeded"), ("going", "running")):
        told.write(Outcome(id, state, ("elbow",)), {"elbow": 0.5}, NOW_NS, 1)  # type: ignore[arg-type]
    return told


def ids(payloads: list[bytes]) -> list[str]:
    return [codec.decode(each, Progress).id for each in payloads]


def test_ends_are_told_when_a_gateway_arrives_and_once_more() -> None:
    """They are repeated, because the gateway may not listen yet the first time."""
    told = report()
    assert told.repeat(0, NOW_NS) == []
    assert ids(told.repeat(1, NOW_NS)) == ["done"]
    assert told.repeat(1, NOW_NS + AGAIN_NS - 1) == []
    assert ids(told.repeat(1, NOW_NS + AGAIN_NS)) == ["done"]
    assert told.repeat(1, NOW_NS + 2 * AGAIN_NS) == []
    assert ids(told.repeat(2, NOW_NS + 2 * AGAIN_NS)) == ["done"]


def test_an_end_is_told_again_when_a_gateway_asks_for_it() -> None:
    told = report()
    for id in ("done", "going", "never"):
        told.repeat_end(id)
    assert ids(told.repeat(0, NOW_NS)) == ["done"]
    assert told.repeat(0, NOW_NS) == []
    told.repeat_end("done")
    assert ids(told.repeat(1, NOW_NS)) == ["done"], "once, although a gateway has arrived as well"


def test_old_ends_are_not_repeated() -> None:
    assert report().repeat(1, NOW_NS + KEPT_NS + 1) == []
