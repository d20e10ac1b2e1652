"""Focus nodes in the data that the targets of a shape select (SHACL 2.1.3)."""

from collections.abc import Callable, Iterable, Mapping

from pyoxigraph import NamedNode, Triple

from linked_fleet_gateway.shacl.data import Data
from linked_fleet_gateway.shacl.statements import fixed
from linked_fleet_gateway.shacl.terms import RDF, RDFS, SHACL, Node, Term


def _of_class(data: Data, wanted: Term) -> Iterable[Term]:
    return (node for each in data.subclasses(wanted) for node in data.subjects(RDF.type, each))


def _subjects_of(data: Data, predicate: Term) -> Iterable[Term]:
    return (subject for subject, _ in data.stated(predicate))


def _objects_of(data: Data, predicate: Term) -> Iterable[Term]:
    return (value for _, value in data.stated(predicate))


TARGETS: Mapping[NamedNode, Callable[[Data, Term], Iterable[Term]]] = {
    SHACL.targetNode: lambda _, node: (node,),
    SHACL.targetClass: _of_class,
    SHACL.targetSubjectsOf: _subjects_of,
    SHACL.targetObjectsOf: _objects_of,
}
_ANY = (*TARGETS, SHACL.target)  # a shape with sh:target is refused as unsupported


def targets(triples: Iterable[Triple]) -> list[tuple[Node, Callable[[Data], Iterable[Term]]]]:
    """Return the shapes of a graph that have targets, each with a function that finds its focus nodes."""
    shapes = Data(list(triples))
    nodes = [
        node for node in shapes.nodes() if any(each in shapes.about(node) for each in _ANY) or _is_class(shapes, node)
    ]
    return [(node, _finder(shapes, node)) for node in nodes]


def _is_class(shapes: Data, node: Node) -> bool:
    """Return True for a shape that is also a class, whose instances are implicit targets."""
    is_shape = shapes.is_a(node, SHACL.NodeShape) or shapes.is_a(node, SHACL.PropertyShape)
    return is_shape and shapes.is_a(node, RDFS.Class)


def _finder(shapes: Data, shape: Node) -> Callable[[Data], Iterable[Term]]:
    stated = [(find, term) for each, find in TARGETS.items() for term in fixed(shapes.objects(shape, each))]
    if _is_class(shapes, shape):
        stated.append((_of_class, shape))
    return lambda data: dict.fromkeys(node for find, term in stated for node in find(data, term))
