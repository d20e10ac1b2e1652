"""What an agent says about the health of its robot shows in the robot's presence, and at its joints."""

import pytest
from pyoxigraph import Literal

from linked_fleet_agent.wire.messages import Condition
from linked_fleet_gateway.resources.resource import Resource
from linked_fleet_gateway.resources.tree import Tree
from linked_fleet_rdf.graph import Graph
from linked_fleet_rdf.vocabulary import LF
from linked_fleet_state.events import Conditioned
from linked_fleet_state.fleet import Change
from linked_fleet_state.invocations import Invocations
from mirrored_fleet import MirroredFleet

SENSOR = "the sensor of elbow contradicts itself"


@pytest.fixture
def mirrored() -> MirroredFleet:
    made = MirroredFleet()
    made.describe("r")
    made.stand("r", (0.5, 0.0))
    return made


def told(mirrored: MirroredFleet, fault: str = "", run: int = 1, **sensors: str) -> list[Change]:
    said = Condition(version=1, incarnation=run, fault=fault, sensors=sensors)
    return mirrored.fleet.apply(Conditioned("r", said), 7)


def faults(mirrored: MirroredFleet, path: str) -> list[str]:
    resource, graph = Tree(mirrored.fleet, Invocations(), "http://example.org").resolve(path), Graph()
    assert isinstance(resource, Resource) and resource.describe is not None
    resource.describe(graph)
    found = [each.object for each in graph.triples if each.predicate == LF.fault]
    return [each.value for each in found if isinstance(each, Literal)]


def test_a_fault_of_the_driver_makes_the_robot_faulty_until_it_is_over(mirrored: MirroredFleet) -> None:
    assert told(mirrored, "read failed: cable out") == [Change("r", "faulty")]
    assert told(mirrored, "read failed: cable out") == []
    robot = mirrored.fleet.robots["r"]
    assert (robot.presence, faults(mirrored, "/r/")) == ("faulty", ["read failed: cable out"])
    assert told(mirrored, "read failed: timeout") == [Change("r", "configured")]
    assert told(mirrored) == [Change("r", "recovered")]
    assert (robot.presence, faults(mirrored, "/r/")) == ("online", [])


def test_a_fault_of_a_sensor_is_shown_at_its_joint_too(mirrored: MirroredFleet) -> None:
    told(mirrored, elbow=SENSOR)
    assert faults(mirrored, "/r/") == faults(mirrored, "/r/elbow") == [SENSOR]
    told(mirrored, "cable out", elbow=SENSOR)
    assert sorted(faults(mirrored, "/r/elbow")) == ["cable out", SENSOR]
    assert faults(mirrored, "/r/slide") == ["cable out"]
    assert mirrored.fleet.robots["r"].presence == "faulty"


def test_another_run_begins_without_the_faults_of_the_one_before(mirrored: MirroredFleet) -> None:
    told(mirrored, "cable out", elbow=SENSOR)
    mirrored.describe("r", 9)
    assert mirrored.fleet.robots["r"].presence == "online"
    assert told(mirrored, "cable out", run=1) == []
    assert mirrored.fleet.robots["r"].presence == "online"
    assert mirrored.fleet.dropped["r"] == 1


def test_the_query_process_has_the_same_presence(mirrored: MirroredFleet) -> None:
    told(mirrored, "cable out")
    assert mirrored.bring().robots["r"].robot.presence == "faulty"
