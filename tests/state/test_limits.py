"""A position outside the URDF's limits is served, marked and counted; if it persists, the robot is faulty."""

import json
import math

import pytest
from pyoxigraph import Literal, NamedNode

from linked_fleet_gateway.actions.plan import ActionRequest, RobotTime, robot_time
from linked_fleet_gateway.resources.body_values import Body
from linked_fleet_gateway.resources.resource import Resource
from linked_fleet_gateway.resources.tree import Tree
from linked_fleet_rdf.graph import Graph
from linked_fleet_rdf.vocabulary import LF, XSD
from linked_fleet_state.fleet import Change, Fleet
from linked_fleet_state.invocations import Invocations
from linked_fleet_state.observation import TOLERANCE_RAD, joints_outside
from linked_fleet_state.robot import Robot
from mirrored_fleet import JOINTS, MirroredFleet

SECOND_NS = 1_000_000_000
BASE = "http://example.org"
TRUE = Literal("true", datatype=XSD.boolean)


@pytest.fixture
def mirrored() -> MirroredFleet:
    made = MirroredFleet()
    made.describe("r")
    made.stand("r", (0.5, 0.0))
    return made


def described(fleet: Fleet, path: str) -> tuple[Resource, Graph]:
    resource = Tree(fleet, Invocations(), BASE).resolve(path)
    assert isinstance(resource, Resource) and resource.describe is not None
    graph = Graph()
    resource.describe(graph)
    return resource, graph


def marked(fleet: Fleet, path: str) -> int:
    return sum(triple.predicate == LF.outOfLimits for triple in described(fleet, path)[1].triples)


def robot_of(mirrored: MirroredFleet) -> Robot:
    return mirrored.fleet.robots["r"]


def test_a_value_outside_is_served_with_its_mark(mirrored: MirroredFleet) -> None:
    assert marked(mirrored.fleet, "/r/elbow/rotation") == 0
    mirrored.stand("r", (77.0, 0.0))
    _, graph = described(mirrored.fleet, "/r/elbow/rotation")
    assert Literal("77.0", datatype=XSD.float) in [triple.object for triple in graph.triples]
    assert [(triple.subject, triple.object) for triple in graph.triples if triple.predicate == LF.outOfLimits] == [
        (NamedNode(f"{BASE}/r/elbow/rotation"), TRUE)
    ]
    assert (marked(mirrored.fleet, "/r/jointState"), marked(mirrored.fleet, "/r/slide/translation")) == (1, 0)
    mirrored.stand("r", (0.5, 7.0))
    assert marked(mirrored.fleet, "/r/elbow/rotation") == 0
    assert (marked(mirrored.fleet, "/r/jointState"), marked(mirrored.fleet, "/r/slide/translation")) == (1, 1)


def test_plain_json_has_the_mark(mirrored: MirroredFleet) -> None:
    mirrored.stand("r", (77.0, 0.0))
    resource, _ = described(mirrored.fleet, "/r/elbow/rotation")
    told = json.loads(resource.documents["application/json"]())
    assert told["outOfLimits"] is True


def test_a_joint_at_its_stop_may_read_a_little_beyond_it(mirrored: MirroredFleet) -> None:
    for position in (1.0 + TOLERANCE_RAD / 2, -1.0 - TOLERANCE_RAD / 2, math.nan):
        mirrored.stand("r", (position, 0.0))
        assert (robot_of(mirrored).joints_outside_limits(), marked(mirrored.fleet, "/r/elbow/rotation")) == ([], 0)
    mirrored.stand("r", (1.0 + 2 * TOLERANCE_RAD, 0.0))
    assert [name for name, _ in robot_of(mirrored).joints_outside_limits()] == ["elbow"]


def test_a_robot_is_faulty_after_a_second_outside_and_online_again_within(mirrored: MirroredFleet) -> None:
    fleet, robot = mirrored.fleet, robot_of(mirrored)
    assert fleet.check_limits("r", 0) is None
    mirrored.stand("r", (77.0, 0.0))
    assert fleet.check_limits("r", 1 * SECOND_NS) is None
    assert (robot.presence, fleet.malformed_counts["r"]) == ("online", 1)
    assert fleet.check_limits("r", 2 * SECOND_NS - 1) is None
    mirrored.stand("r", (78.0, 0.0))
    assert fleet.check_limits("r", 2 * SECOND_NS) == Change("r", "faulty")
    assert (robot.presence, robot.positions["elbow"], fleet.malformed_counts["r"]) == ("faulty", 78.0, 2)
    assert "elbow" in (robot.fault or "")
    _, graph = described(fleet, "/r/")
    assert LF.faulty in [triple.object for triple in graph.triples if triple.predicate == LF.presence]
    assert fleet.check_limits("r", 3 * SECOND_NS) is None
    mirrored.stand("r", (0.5, 0.0))
    assert fleet.check_limits("r", 4 * SECOND_NS) == Change("r", "recovered")
    assert (robot.presence, robot.fault) == ("online", None)


def test_one_bad_frame_is_a_complaint_and_no_fault(mirrored: MirroredFleet) -> None:
    fleet = mirrored.fleet
    mirrored.stand("r", (77.0, 0.0))
    fleet.check_limits("r", 1 * SECOND_NS)
    mirrored.stand("r", (0.5, 0.0))
    fleet.check_limits("r", SECOND_NS * 5 // 4)
    mirrored.stand("r", (77.0, 0.0))
    assert fleet.check_limits("r", 3 * SECOND_NS) is None
    assert (robot_of(mirrored).presence, fleet.malformed_counts["r"]) == ("online", 2)


def test_a_request_after_a_stop_is_later_than_it_before_the_next_frame(mirrored: MirroredFleet) -> None:
    robot = robot_of(mirrored)
    frame = robot.frame
    assert frame is not None and robot.incarnation is not None
    for stopped_ns, seen_ns in (
        (frame.monotonic_ns - 1, frame.monotonic_ns),
        (frame.monotonic_ns, frame.monotonic_ns + 1),
        (frame.monotonic_ns + 5_000_000, frame.monotonic_ns + 5_000_001),
        (frame.monotonic_ns + 10 * SECOND_NS, frame.monotonic_ns),  # by the clock of another machine
    ):
        robot.stopped_ns = stopped_ns
        assert robot_time(robot) == RobotTime(robot.incarnation, seen_ns)


def test_a_robot_outside_its_limits_takes_motions(mirrored: MirroredFleet) -> None:
    """Other joints move, and this one moves back: its agent judges that."""
    fleet, robot = mirrored.fleet, robot_of(mirrored)
    mirrored.stand("r", (1.3, 0.0))
    for now_s in (1, 2):
        fleet.check_limits("r", now_s * SECOND_NS)
    assert robot.presence == "faulty"
    moment = robot_time(robot)
    assert isinstance(moment, RobotTime)
    assert ActionRequest(BASE, Body((), NamedNode(BASE)), robot, robot_time=moment).required_time() == moment


@pytest.mark.parametrize("run", [None, 9])
def test_the_end_of_a_run_ends_its_fault(mirrored: MirroredFleet, run: int | None) -> None:
    fleet, robot = mirrored.fleet, robot_of(mirrored)
    mirrored.stand("r", (77.0, 0.0))
    for now_s in (1, 2):
        fleet.check_limits("r", now_s * SECOND_NS)
    assert robot.presence == "faulty"
    if run is None:
        mirrored.leave("r")
        assert robot.presence == "offline"
    else:
        mirrored.describe("r", run)
        assert robot.presence == "online"
    fleet.check_limits("r", 3 * SECOND_NS)
    assert robot.fault is None


def test_the_query_process_has_the_same_presence(mirrored: MirroredFleet) -> None:
    mirrored.stand("r", (77.0, 0.0))
    for now_s in (1, 2):
        mirrored.fleet.check_limits("r", now_s * SECOND_NS)
    copy = mirrored.bring().robots["r"].robot
    assert (copy.presence, copy.positions["elbow"]) == ("faulty", 77.0)


def test_positions_are_found_where_they_stand_in_a_frame(mirrored: MirroredFleet) -> None:
    mirrored.stand("r", (0.5, 77.0))
    payload = robot_of(mirrored).payload
    assert payload is not None
    bounds = dict.fromkeys(JOINTS, (-1.0, 1.0))
    assert joints_outside(payload, False, bounds) == [("slide", 77.0)]
