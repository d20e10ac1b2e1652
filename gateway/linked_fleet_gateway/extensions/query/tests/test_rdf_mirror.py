"""Queries see what GET serves, whatever happens to the robots in between."""

from typing import Any

import pytest

from linked_fleet_agent.wire.messages import Base
from linked_fleet_gateway.extensions.query.rdf_mirror import RdfMirror
from linked_fleet_rdf.vocabulary import LF
from linked_fleet_state.invocation import Lease
from linked_fleet_state.invocations import Invocation, InvocationState
from linked_fleet_state.robot import KeptPose, Robot
from mirrored_fleet import MirroredFleet
from mirrored_graphs import BASE, canonical, held, served


@pytest.fixture
def mirrored() -> MirroredFleet:
    return MirroredFleet()


def invocation(id: str, robot: str, state: InvocationState = InvocationState.RUNNING, **more: object) -> Invocation:
    body = "_:input <http://vocab.arvida.de/2015/06/vom/vocab#numericalValue> _:deep ."
    action = f"/{robot}/elbow/actions/rotate"
    given = {"targets": {"elbow": 0.25}, "created_ns": 10**9, "deadline_ns": 10**10, "client": "ann", "body": body}
    return Invocation(id, robot, action, state=state, **(given | more))  # type: ignore[arg-type]


def test_the_mirror_equals_the_served_descriptions(mirrored: MirroredFleet) -> None:
    rdf_mirror = RdfMirror(BASE)

    def same(*names: str) -> None:
        rdf_mirror.update(mirrored.bring())
        for name in names:
            assert canonical(held(rdf_mirror, name)) == canonical(served(mirrored, name)), name

    mirrored.describe("a", annotations='<> <http://x/made> [ <http://x/by> "somebody" ] .')
    mirrored.describe("b", floating=True)
    same("a", "b")  # no frame yet
    mirrored.stand("a", (0.1, 0.2))
    mirrored.stand("b", (0.0, 0.0), base=Base((1.0, 2.0, 3.0), (0.0, 0.0, 0.0, 1.0), (0.0,) * 3, (0.0,) * 3))
    same("a", "b")
    mirrored.stand("a", (0.3, 0.2))
    same("a", "b")
    mirrored.invocations.add(invocation("i-1", "a"))
    mirrored.invocations.add(invocation("i-2", "a", preempts=("i-1",), created_ns=2 * 10**9))
    robot = mirrored.fleet.robots["a"]
    robot.targets = {"elbow": 0.25}
    robot.set_poses({"up": KeptPose("/a/poses/1", {"elbow": 0.1}), "far": KeptPose("/a/poses/2", {"nose": 0.1})})
    mirrored.fleet.control("a", Lease("l", "a", "ann", 1, 2 * 10**9, 5.0))
    mirrored.fleet.configure("b", {"title": "Other", "maximumSpeedScale": "0.5"})
    same("a", "b")
    one = mirrored.invocations.get("i-1")
    assert one is not None
    one.state, one.preempted_by, one.ended_ns = InvocationState.PREEMPTED, "i-2", 3 * 10**9
    same("a", "b")
    mirrored.invocations.remove("i-1")
    mirrored.leave("a")
    mirrored.describe("b", 2)  # another run, with a fixed base
    same("a", "b")
    mirrored.stand("b", (0.0, 0.4), 2)
    same("a", "b")


def test_a_robot_that_cannot_be_described_has_the_reason_and_the_others_are_there(
    mirrored: MirroredFleet, monkeypatch: pytest.MonkeyPatch
) -> None:
    rdf_mirror, usual = RdfMirror(BASE), RdfMirror._write_parts

    def broken(self: RdfMirror, known: Any, robot: Robot) -> None:
        if robot.name == "b":
            raise RuntimeError("planted")
        usual(self, known, robot)

    def reasons(name: str) -> list[str]:
        return [quad.object.value for quad in held(rdf_mirror, name) if quad.predicate == LF.fault]

    for name in ("a", "b"):
        mirrored.describe(name)
    with monkeypatch.context() as planted:
        planted.setattr(RdfMirror, "_write_parts", broken)
        for _ in range(2):
            rdf_mirror.update(mirrored.bring())
            assert canonical(held(rdf_mirror, "a")) == canonical(served(mirrored, "a"))
            assert reasons("b") == ["queries cannot describe b: RuntimeError: planted"]
            mirrored.describe("b", 2, annotations='<> <http://x/made> "again" .')
    rdf_mirror.update(mirrored.bring())
    assert reasons("b") == []
    assert canonical(held(rdf_mirror, "b")) == canonical(served(mirrored, "b"))


@pytest.mark.parametrize("moved", [(0.1, 0.2), (0.1000001, 0.2)])
def test_unchanged_values_are_not_written_again(mirrored: MirroredFleet, moved: tuple[float, float]) -> None:
    rdf_mirror = RdfMirror(BASE)
    mirrored.describe("a")
    mirrored.stand("a", (0.1, 0.2))
    rdf_mirror.update(mirrored.bring())
    before = set(rdf_mirror.store)
    mirrored.stand("a", moved)
    rdf_mirror.update(mirrored.bring())
    changed = before ^ set(rdf_mirror.store)
    assert {quad.predicate.value for quad in changed} == {"https://w3id.org/linked-fleet#lastFrame"}


def test_statements_of_an_unusable_description_are_removed(mirrored: MirroredFleet) -> None:
    rdf_mirror = RdfMirror(BASE)
    mirrored.describe("a")
    mirrored.stand("a", (0.1, 0.2))
    rdf_mirror.update(mirrored.bring())
    mirrored.fleet.robots["a"].reject_description("it makes no sense")
    rdf_mirror.update(mirrored.bring())
    assert canonical(held(rdf_mirror, "a")) == canonical(served(mirrored, "a"))
