"""A SHACL shape as typed values: constraints of a node and of the nodes below it."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import reduce

from rdflib import BNode, Graph
from rdflib.term import Literal, Node, URIRef

from linked_fleet_client.quantity import UNIT_PATHS, number
from linked_fleet_client.vocabulary import DCTERMS, RDF, SH, local_name

_DEEPEST = 12
_LONGEST_LIST = 2000


@dataclass(frozen=True)
class Bound:
    """An end of a range of numbers."""

    value: float
    inclusive: bool


@dataclass(frozen=True)
class Shape:
    """A node shape.

    Empty tuples and None are no constraint; for each group in ``alternatives`` one branch must be met.
    """

    classes: tuple[URIRef, ...] = ()
    datatypes: tuple[URIRef, ...] = ()
    choices: tuple[Node, ...] | None = None
    lower: Bound | None = None
    upper: Bound | None = None
    node_kind: URIRef | None = None
    fields: tuple["Field", ...] = ()
    alternatives: tuple[tuple["Shape", ...], ...] = ()

    def field(self, path: URIRef) -> "Field | None":
        return next((field for field in self.fields if field.path == path), None)


@dataclass(frozen=True)
class Field:
    """A property shape: cardinality of a predicate and constraints of its values; ``fixed`` values must be present.

    ``format`` is the media type of a text value, or of the text in which a blank node is written.
    """

    path: URIRef
    name: str
    shape: Shape
    description: str = ""
    min_count: int = 0
    max_count: int | None = None
    fixed: tuple[Node, ...] = ()
    default: Node | None = None
    order: float = 0.0
    format: str = ""

    @property
    def allowed(self) -> tuple[Node, ...] | None:
        """The valid values; None if any value is valid."""
        return self.fixed or self.shape.choices


def read_shape(graph: Graph, node: Node, above: tuple[Node, ...] = ()) -> Shape:
    """Return the shape ``node``. Constraints that are not understood are ignored: the server validates."""
    if node in above or len(above) > _DEEPEST:
        return Shape()  # recursive shapes have no meaning in SHACL
    above = (*above, node)
    own = Shape(
        classes=_iris(graph, node, SH.targetClass, SH["class"]),
        datatypes=_iris(graph, node, SH.datatype),
        choices=_choices(graph, node),
        lower=_bound(graph, node, SH.minInclusive, SH.minExclusive),
        upper=_bound(graph, node, SH.maxInclusive, SH.maxExclusive),
        node_kind=next(iter(_iris(graph, node, SH.nodeKind)), None),
        fields=_fields(graph, node, above),
    )
    more = [
        *graph.objects(node, SH.node),
        *(each for head in graph.objects(node, SH["and"]) for each in _list(graph, head)),
    ]
    shape = conjunction([own, *(read_shape(graph, each, above) for each in _ordered(more))])
    for predicate in (SH["or"], SH.xone):
        for head in graph.objects(node, predicate):
            shape = _either(shape, tuple(read_shape(graph, each, above) for each in _list(graph, head)))
    return shape


def conjunction(shapes: Iterable[Shape]) -> Shape:
    """Return the conjunction of ``shapes``."""
    return reduce(_both, shapes, Shape())


def with_branches(shape: Shape, branches: Iterable[Shape]) -> Shape:
    """Return ``shape`` with the given branches in place of its alternatives."""
    return conjunction([replace(shape, alternatives=()), *branches])


def _both(one: Shape, other: Shape) -> Shape:
    paths = dict.fromkeys(field.path for field in (*one.fields, *other.fields))
    return Shape(
        classes=tuple(dict.fromkeys((*one.classes, *other.classes))),
        datatypes=_datatypes(one.datatypes, other.datatypes),
        choices=_common(one.choices, other.choices),
        lower=_tighter(one.lower, other.lower, 1),
        upper=_tighter(one.upper, other.upper, -1),
        node_kind=one.node_kind or other.node_kind,
        fields=tuple(_one_field(one.field(path), other.field(path)) for path in paths),
        alternatives=(*one.alternatives, *other.alternatives),
    )


def _one_field(one: Field | None, other: Field | None) -> Field:
    if one is None or other is None:
        present = one or other
        assert present is not None
        return present
    counts = [count for count in (one.max_count, other.max_count) if count is not None]
    return Field(
        path=one.path,
        name=one.name if one.name != local_name(str(one.path)) else other.name,
        shape=_both(one.shape, other.shape),
        description=one.description or other.description,
        min_count=max(one.min_count, other.min_count),
        max_count=min(counts) if counts else None,
        fixed=tuple(dict.fromkeys((*one.fixed, *other.fixed))),
        default=one.default if one.default is not None else other.default,
        order=one.order or other.order,
        format=one.format or other.format,
    )


def _common(one: tuple[Node, ...] | None, other: tuple[Node, ...] | None) -> tuple[Node, ...] | None:
    if one is None or other is None:
        return other if one is None else one
    return tuple(each for each in one if each in other)


def _datatypes(one: tuple[URIRef, ...], other: tuple[URIRef, ...]) -> tuple[URIRef, ...]:
    return tuple(each for each in one if each in other) if one and other else one or other


def _tighter(one: Bound | None, other: Bound | None, sign: int) -> Bound | None:
    bounds = [bound for bound in (one, other) if bound is not None]
    return max(bounds, key=lambda bound: (sign * bound.value, not bound.inclusive), default=None)


def _either(shape: Shape, branches: tuple[Shape, ...]) -> Shape:
    """Merge alternatives that differ only in their datatype into one choice of datatypes."""
    if branches and all(branch == Shape(datatypes=branch.datatypes) and branch.datatypes for branch in branches):
        return _both(shape, Shape(datatypes=tuple(each for branch in branches for each in branch.datatypes)))
    return replace(shape, alternatives=(*shape.alternatives, branches)) if branches else shape


def _fields(graph: Graph, node: Node, above: tuple[Node, ...]) -> tuple[Field, ...]:
    read = [_field(graph, each, above) for each in _ordered(graph.objects(node, SH.property))]
    found = [field for field in read if field is not None]
    one_each: dict[URIRef, Field] = {}
    for field in found:
        one_each[field.path] = _one_field(one_each.get(field.path), field)
    return tuple(sorted(one_each.values(), key=_rank))


def _rank(field: Field) -> tuple[float, bool, bool, str]:
    """Return the sort key: sh:order, required before optional, a number before its unit."""
    return field.order, field.min_count == 0, field.path in UNIT_PATHS, field.name


def _field(graph: Graph, node: Node, above: tuple[Node, ...]) -> Field | None:
    """Return None for what cannot be filled in: a complex path or a deactivated shape."""
    path = _predicate(graph, graph.value(node, SH.path))
    if path is None or str(graph.value(node, SH.deactivated)).lower() in ("true", "1"):
        return None
    name = graph.value(node, SH.name)
    return Field(
        path=path,
        name=str(name) if isinstance(name, Literal) and str(name) else local_name(str(path)),
        shape=read_shape(graph, node, above),
        description=str(graph.value(node, SH.description) or ""),
        min_count=max(_integer(graph, node, SH.minCount) or 0, 1 if (node, SH.hasValue, None) in graph else 0),
        max_count=_integer(graph, node, SH.maxCount),
        fixed=tuple(_ordered(graph.objects(node, SH.hasValue))),
        default=graph.value(node, SH.defaultValue),
        order=_number(graph.value(node, SH.order)) or 0.0,
        format=str(graph.value(node, DCTERMS["format"]) or ""),
    )


def _predicate(graph: Graph, path: Node | None) -> URIRef | None:
    if isinstance(path, BNode):  # any of the alternative paths will do
        head = graph.value(path, SH.alternativePath)
        path = next(iter(_list(graph, head)), None) if head is not None else None
    return path if isinstance(path, URIRef) else None


def _choices(graph: Graph, node: Node) -> tuple[Node, ...] | None:
    heads = list(graph.objects(node, SH["in"]))
    return tuple(_list(graph, heads[0])) if heads else None


def _bound(graph: Graph, node: Node, inclusive: URIRef, exclusive: URIRef) -> Bound | None:
    found = [(_number(graph.value(node, predicate)), predicate == inclusive) for predicate in (exclusive, inclusive)]
    return next((Bound(value, closed) for value, closed in found if value is not None), None)


def _number(term: Node | None) -> float | None:
    return number(term) if isinstance(term, Literal) else None


def _integer(graph: Graph, node: Node, predicate: URIRef) -> int | None:
    value = _number(graph.value(node, predicate))
    return int(value) if value is not None and abs(value) < 1e9 else None


def _iris(graph: Graph, node: Node, *predicates: URIRef) -> tuple[URIRef, ...]:
    found = [each for predicate in predicates for each in _ordered(graph.objects(node, predicate))]
    return tuple(dict.fromkeys(each for each in found if isinstance(each, URIRef)))


def _list(graph: Graph, head: Node) -> Sequence[Node]:
    """Return the members of an RDF list up to the first malformed node."""
    found: list[Node] = []
    seen: set[Node] = set()
    while head != RDF.nil and head not in seen and len(found) < _LONGEST_LIST:
        seen.add(head)
        first, rest = graph.value(head, RDF.first), graph.value(head, RDF.rest)
        if first is None or rest is None:
            break
        found.append(first)
        head = rest
    return found


def _ordered(nodes: Iterable[Node]) -> list[Node]:
    return sorted(nodes, key=str)
