"""Which things offer which actions: by class, by the agent's capabilities, and by structure."""

from typing import Any

import pytest
from pyoxigraph import Literal, NamedNode

from linked_fleet_gateway.actions.action_handlers import HANDLERS
from linked_fleet_gateway.extensions.faults.terms import LF as FAULT_LF
from linked_fleet_gateway.extensions.missions.terms import LF as MISSION_LF
from linked_fleet_gateway.extensions.navigation.drive_to import LF as NAVIGATION_LF
from linked_fleet_gateway.extensions.people.terms import LF as PEOPLE_LF
from linked_fleet_gateway.extensions.queue.terms import LF as QUEUE_LF
from linked_fleet_gateway.extensions.reach.can_reach import LF
from linked_fleet_gateway.extensions.world.placement import LF as WORLD_LF
from linked_fleet_gateway.resources.action_offer import action_definitions, fleet_offers, joint_offers, robot_offers
from linked_fleet_rdf.turtle import write_turtle
from linked_fleet_rdf.vocabulary import DCTERMS, HTTP, HYBRIT, METHODS, PREFIXES, RDF

_LIMIT = '<limit lower="-1" upper="1" velocity="1" effort="1"/>'
_JOINTS = {
    "elbow": ("revolute", _LIMIT),
    "wheel": ("continuous", ""),
    "lift": ("prismatic", _LIMIT),
    "free": ("revolute", ""),
    "finger": ("revolute", _LIMIT + '<mimic joint="elbow"/>'),
    "plate": ("fixed", ""),
    "flap": ("floating", ""),
    "table": ("planar", ""),
}
_TARGET = "lf:target [ lf:ofJoint <elbow> ; vom:numericalValue 1 ; vom:unit unit:RAD ]"
_POSE = f'<> lf:namedPose [ dcterms:title "up" ; {_TARGET} ] .'


def _segments(offers: Any) -> set[str]:
    return {each.definition.segment for each in offers}


@pytest.mark.parametrize(
    ("joint", "offered"),
    [
        ("elbow", {"rotate", "rotateBy", "hold"}),
        ("wheel", {"rotate", "rotateBy", "hold"}),
        ("lift", {"translate", "translateBy", "hold"}),
        ("free", {"hold"}),
        ("finger", set()),
        ("plate", set()),
        ("flap", set()),
        ("table", set()),
    ],
)
def test_actions_of_joints(bench: Any, joint: str, offered: set[str]) -> None:
    """None for a joint that does not move by itself; no target for one with unknown limits. Others get 404."""
    robot = bench.robot(_JOINTS)
    assert robot.model is not None
    assert _segments(joint_offers(robot, robot.model.joints[joint])) == offered
    for each in ("rotate", "rotateBy", "translate", "translateBy", "hold"):
        assert (bench.resource(f"/r/{joint}/actions/{each}") is not None) == (each in offered)
    graph = bench.described(f"/r/{joint}")
    linked = {t.object.value.rpartition("/")[2] for t in graph.triples if t.predicate == HYBRIT.action}
    assert linked == offered


@pytest.mark.parametrize(
    ("capabilities", "of_robot", "of_joint"),
    [
        ((), set(), set()),
        (("stop",), {"stop"}, {"hold"}),
        (("move",), {"moveJoints", "reach", "assumePose"}, {"rotate", "rotateBy"}),
        (("follow", "fly"), {"followTrajectory"}, set()),
    ],
)
def test_actions_are_those_that_the_agent_can_do(
    bench: Any, capabilities: tuple[str, ...], of_robot: set[str], of_joint: set[str]
) -> None:
    """An unknown capability adds none."""
    robot = bench.robot(_JOINTS, capabilities=capabilities, annotations=_POSE)
    assert robot.model is not None
    assert _segments(robot_offers(robot)) == of_robot
    assert _segments(joint_offers(robot, robot.model.joints["elbow"])) == of_joint


def test_actions_of_robots_need_what_they_move(bench: Any) -> None:
    """Without commandable joints only stop; without poses no assumePose; those of the fleet are always there."""
    still = {name: _JOINTS[name] for name in ("plate", "free", "flap")}
    assert _segments(robot_offers(bench.robot(still, annotations=_POSE))) == {"stop"}
    everything = {"moveJoints", "followTrajectory", "reach", "stop"}
    assert _segments(robot_offers(bench.robot(_JOINTS))) == everything
    assert _segments(robot_offers(bench.robot(_JOINTS, annotations=_POSE))) == {*everything, "assumePose"}
    assert _segments(fleet_offers()) == {"stopAll", "raiseFault"}


def test_a_robot_without_a_usable_description_offers_nothing(bench: Any) -> None:
    """Its capabilities are unknown."""
    robot = bench.robot(_JOINTS)
    robot.reject_description("a test says so")
    assert robot_offers(robot) == []
    assert bench.resource("/r/actions/stop") is None


def test_each_kind_of_action_has_a_file_and_a_handler() -> None:
    """Neither without the other; no two of one thing have the same segment."""
    assert {each.iri for each in action_definitions()} == {
        *HANDLERS,
        LF.Reach,
        WORLD_LF.Relocalise,
        NAVIGATION_LF.DriveTo,
        NAVIGATION_LF.DriveNear,
        *(MISSION_LF.terms[each] for each in ("PauseRun", "ResumeRun", "RetryStep", "SkipStep", "AnswerStep")),
        *(FAULT_LF.terms[each] for each in ("RaiseFault", "AcknowledgeFault", "RemarkFault", "ClearFault")),
        *(PEOPLE_LF.terms[each] for each in ("HandOverControl", "RefuseControl")),
        *(QUEUE_LF.terms[each] for each in ("MoveOrder", "WithdrawOrder")),
    }
    for one in action_definitions():
        assert not any(
            one is not other and one.segment == other.segment and one.offered_by & other.offered_by
            for other in action_definitions()
        )
        assert one.title
        assert one.comment


def test_methods_and_bodies_are_those_of_the_file(bench: Any) -> None:
    """PUT only if repeating it changes nothing."""
    bench.robot(_JOINTS, annotations=_POSE)
    methods = {
        "/r/elbow/actions/rotate": ("POST", "PUT"),
        "/r/elbow/actions/rotateBy": ("POST",),
        "/r/elbow/actions/hold": ("POST",),
        "/r/actions/moveJoints": ("POST", "PUT"),
        "/r/actions/followTrajectory": ("POST",),
        "/r/actions/reach": ("POST", "PUT"),
        "/r/actions/stop": ("POST",),
        "/actions/stopAll": ("POST",),
    }
    for path, expected in methods.items():
        offer, graph = bench.offer(path), bench.described(path)
        assert offer.methods == expected, path
        bound = {t.object for t in graph.triples if t.predicate == HTTP.mthd}
        assert bound == {METHODS.PUT if each == "PUT" else METHODS.POST for each in expected}
        consumed = [t for t in graph.triples if t.predicate == HYBRIT.consumes]
        assert len(consumed) == offer.takes_body == (path.rpartition("/")[2] not in ("hold", "stop", "stopAll"))


def test_a_description_is_the_same_each_time(bench: Any) -> None:
    """An ETag stays valid as long as the description."""
    bench.robot(_JOINTS, annotations=_POSE)
    for path in ("/r/elbow/actions/rotate", "/r/actions/reach", "/r/actions/assumePose"):
        first, second = (
            write_turtle(bench.described(path).triples, PREFIXES, base=bench.base + path) for _ in range(2)
        )
        assert first == second
        iri = NamedNode(bench.base + path)
        about = {(t.predicate, t.object) for t in bench.described(path).triples if t.subject == iri}
        assert {(RDF.type, HYBRIT.Action), (RDF.type, bench.offer(path).definition.iri)} <= about
        assert (DCTERMS.title, Literal(bench.offer(path).name)) in about
        assert (LF.invocations, NamedNode(iri.value + "/invocations")) in about
