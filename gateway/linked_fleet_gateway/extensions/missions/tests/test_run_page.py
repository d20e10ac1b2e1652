"""The page of a run: the whole tree of its mission, with what has become of each step."""

from pyoxigraph import NamedNode

from linked_fleet_gateway.api import Graph
from linked_fleet_gateway.extensions.missions import page
from linked_fleet_gateway.extensions.missions.describing import describe_run
from linked_fleet_gateway.extensions.missions.mission import FirstOf, Mission, Notify, Repeat, Sequence
from linked_fleet_gateway.extensions.missions.record import Creator, Run, StepRun
from linked_fleet_gateway.extensions.pages.api import Facts

BASE = "http://a"
S = 1_000_000_000


def rows(step: Sequence, steps: dict[str, StepRun]) -> list[tuple[str, str, bool]]:
    """Return path, title and whether it has not begun, of each row in the order of the page."""
    run = Run(Mission("m", step), "/missions/1", BASE, {}, Creator(), began_ns=S, steps=steps)
    graph, iri = Graph(), NamedNode(f"{BASE}/mission-runs/1")
    describe_run(graph, iri, run)
    return [
        (each.path, each.title, each.is_pending)
        for each in page.run(Facts(graph.triples, f"{BASE}/"), iri).more["steps"]
    ]


def test_steps_that_have_not_begun_stand_in_their_place() -> None:
    step = Sequence((Notify("a", title="a"), FirstOf((Notify("b", title="b"), Notify("c", title="c")), title="f")))
    done = StepRun("succeeded", began_ns=S, ended_ns=2 * S)
    assert rows(step, {}) == [
        ("0", "", False), ("0.0", "a", True), ("0.1", "f", False), ("0.1.0", "b", True), ("0.1.1", "c", True)
    ]  # fmt: skip
    assert rows(step, {"0.1.0": done, "0.0": done}) == [
        ("0", "", False), ("0.0", "a", False), ("0.1", "f", False), ("0.1.0", "b", False), ("0.1.1", "c", True)
    ]  # fmt: skip


def test_rounds_stand_below_their_heading_and_before_what_has_not_begun() -> None:
    step = Sequence((Repeat(Sequence((Notify("a", title="a"), Notify("b", title="b"))), 3), Notify("c", title="c")))
    done, now = StepRun("succeeded", began_ns=S, ended_ns=2 * S), StepRun("running", began_ns=S)
    assert rows(step, {"0.0.0#0.0": now}) == [
        ("0", "", False), ("0.0", "", False), ("0.0.0", "", False), ("0.0.0#0.0", "a", False), ("0.0.0.1", "b", True),
        ("0.1", "c", True),
    ]  # fmt: skip
    steps = {"0.0.0#0.0": done, "0.0.0#0.1": done, "0.0.0#10.0": done, "0.0.0#2.0": done}
    assert [path for path, _, _ in rows(step, steps)] == [
        "0", "0.0", "0.0.0", "0.0.0#0.0", "0.0.0#0.1", "0.0.0#2.0", "0.0.0#10.0", "0.1"
    ]  # fmt: skip
