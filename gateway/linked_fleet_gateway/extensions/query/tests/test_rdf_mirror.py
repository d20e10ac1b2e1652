"""Queries see what GET serves, whatever happens to the robots in between."""

from collections.abc import Iterator

import pytest
from pyoxigraph import BlankNode, CanonicalizationAlgorithm, Dataset, NamedNode, Quad, Store, Triple

from linked_fleet_agent.wire.messages import Base
from linked_fleet_gateway.extensions.query.rdf_mirror import RdfMirror
from linked_fleet_gateway.fleet.invocation import Lease
from linked_fleet_gateway.fleet.invocations import Invocation, InvocationState
from linked_fleet_gateway.rdf.graph import Graph
from linked_fleet_gateway.resources.invocation import invocation_path
from linked_fleet_gateway.resources.paths import lease_path, robot_path
from linked_fleet_gateway.resources.resource import Resource
from linked_fleet_gateway.resources.tree import Tree
from pictured import Pictured

BASE = "http://fleet.example"


@pytest.fixture
def pictured() -> Pictured:
    return Pictured()


def served(pictured: Pictured, name: str) -> Dataset:
    """Return all triples that GET serves for a robot and its parts."""
    tree = Tree(pictured.fleet, pictured.invocations, BASE)
    robot = tree.resolve(robot_path(name))
    assert isinstance(robot, Resource)
    paths = [robot.path, lease_path(name), *robot.parts, *map(invocation_path, pictured.invocations.of_robot(name))]
    store = Store()  # the store normalizes numbers by type: 1.0 and 1 are one xsd:float
    for at, path in enumerate(paths):
        store.extend(Quad(*_own(triple, f"p{at}x")) for triple in _described(tree, path))
    return Dataset(store)


def _described(tree: Tree, path: str) -> list[Triple]:
    found, graph = tree.resolve(path), Graph()
    assert isinstance(found, Resource)
    assert found.describe is not None
    found.describe(graph)
    return graph.triples


def _own(triple: Triple, prefix: str) -> Iterator[object]:
    return (BlankNode(prefix + term.value) if isinstance(term, BlankNode) else term for term in triple)


def held(rdf_mirror: RdfMirror, name: str) -> Dataset:
    quads = rdf_mirror.store.quads_for_pattern(None, None, None, NamedNode(BASE + robot_path(name)))
    return Dataset(Quad(quad.subject, quad.predicate, quad.object) for quad in quads)


def canonical(dataset: Dataset) -> set[str]:
    dataset.canonicalize(CanonicalizationAlgorithm.RDFC_1_0)
    return set(map(str, dataset))


def invocation(id: str, robot: str, state: InvocationState = InvocationState.RUNNING, **more: object) -> Invocation:
    body = "_:input <http://vocab.arvida.de/2015/06/vom/vocab#numericalValue> _:deep ."
    action = f"/{robot}/elbow/actions/rotate"
    given = {"targets": {"elbow": 0.25}, "created_ns": 10**9, "deadline_ns": 10**10, "client": "ann", "body": body}
    return Invocation(id, robot, action, state=state, **(given | more))  # type: ignore[arg-type]


def test_the_mirror_equals_the_served_descriptions(pictured: Pictured) -> None:
    rdf_mirror = RdfMirror(BASE)

    def same(*names: str) -> None:
        rdf_mirror.bring(pictured.bring())
        for name in names:
            assert canonical(held(rdf_mirror, name)) == canonical(served(pictured, name)), name

    pictured.describe("a", annotations='<> <http://x/made> [ <http://x/by> "somebody" ] .')
    pictured.describe("b", floating=True)
    same("a", "b")  # no frame yet
    pictured.stand("a", (0.1, 0.2))
    pictured.stand("b", (0.0, 0.0), base=Base((1.0, 2.0, 3.0), (0.0, 0.0, 0.0, 1.0), (0.0,) * 3, (0.0,) * 3))
    same("a", "b")
    pictured.stand("a", (0.3, 0.2))
    same("a", "b")
    pictured.invocations.add(invocation("i-1", "a"))
    pictured.invocations.add(invocation("i-2", "a", preempts=("i-1",), created_ns=2 * 10**9))
    robot = pictured.fleet.robots["a"]
    robot.targets = {"elbow": 0.25}
    robot.tell_news()
    pictured.fleet.control("a", Lease("l", "a", "ann", 1, 2 * 10**9, 5.0))
    pictured.fleet.configure("b", {"title": "Other", "maximumSpeedScale": "0.5"})
    same("a", "b")
    one = pictured.invocations.get("i-1")
    assert one is not None
    one.state, one.preempted_by, one.ended_ns = InvocationState.PREEMPTED, "i-2", 3 * 10**9
    same("a", "b")
    pictured.invocations.remove("i-1")
    pictured.leave("a")
    pictured.describe("b", 2)  # another run, with a fixed base
    same("a", "b")
    pictured.stand("b", (0.0, 0.4), 2)
    same("a", "b")


@pytest.mark.parametrize("moved", [(0.1, 0.2), (0.1000001, 0.2)])
def test_unchanged_values_are_not_written_again(pictured: Pictured, moved: tuple[float, float]) -> None:
    rdf_mirror = RdfMirror(BASE)
    pictured.describe("a")
    pictured.stand("a", (0.1, 0.2))
    rdf_mirror.bring(pictured.bring())
    before = set(rdf_mirror.store)
    pictured.stand("a", moved)
    rdf_mirror.bring(pictured.bring())
    changed = before ^ set(rdf_mirror.store)
    assert {quad.predicate.value for quad in changed} == {"https://w3id.org/linked-fleet#lastFrame"}


def test_statements_of_an_unusable_description_are_removed(pictured: Pictured) -> None:
    rdf_mirror = RdfMirror(BASE)
    pictured.describe("a")
    pictured.stand("a", (0.1, 0.2))
    rdf_mirror.bring(pictured.bring())
    pictured.fleet.robots["a"].undescribe("it makes no sense")
    rdf_mirror.bring(pictured.bring())
    assert canonical(held(rdf_mirror, "a")) == canonical(served(pictured, "a"))
