"""The graphs of a robot: as it is served, and as it is in the store of queries."""

from collections.abc import Iterator

from pyoxigraph import BlankNode, CanonicalizationAlgorithm, Dataset, NamedNode, Quad, Store, Triple

from linked_fleet_gateway.extensions.query.rdf_mirror import RdfMirror
from linked_fleet_gateway.resources.invocation import invocation_path
from linked_fleet_gateway.resources.paths import lease_path, robot_path
from linked_fleet_gateway.resources.resource import Resource
from linked_fleet_gateway.resources.tree import Tree
from linked_fleet_rdf.graph import Graph
from mirrored_fleet import MirroredFleet

BASE = "http://fleet.example"


def served(mirrored: MirroredFleet, name: str) -> Dataset:
    """Return all triples that GET serves for a robot and its parts."""
    tree = Tree(mirrored.fleet, mirrored.invocations, BASE)
    robot = tree.resolve(robot_path(name))
    assert isinstance(robot, Resource)
    paths = [
        robot.path,
        lease_path(name),
        *robot.part_paths,
        *map(invocation_path, mirrored.invocations.of_robot(name)),
    ]
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
