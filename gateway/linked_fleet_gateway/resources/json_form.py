"""JSON forms and JSON Schemas (W3C WoT Thing Description 1.1, 5.3.2) derived from SHACL node shapes.

A property of a shape becomes a member named by its ``sh:name``. A property without a name is skipped, but the named
properties of its value node become members in its place. ``sh:or`` between nodes becomes ``oneOf``, limits ``minimum``
and ``maximum``, ``sh:minCount`` ``required``, and ``lf:unknown`` beside a number ``null``.

``linked_fleet_client.shape`` reads shapes too, for the forms of pages and for the client. It is another model: what
can be filled in, with units and the bounds of several shapes merged, of an rdflib graph fetched from any server. This
one says how values are served and accepted as JSON, in a package that must not load rdflib, which the client needs.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence

from pyoxigraph import Literal, NamedNode, Triple

from linked_fleet_base.contributions import present
from linked_fleet_base.errors import Statement
from linked_fleet_gateway.resources.action_offer import Offer
from linked_fleet_gateway.resources.form import Field, Form, Json, Value
from linked_fleet_gateway.resources.settable import describe_target_input
from linked_fleet_rdf.graph import Graph, Node, Term
from linked_fleet_rdf.shapes import BLUEPRINTS, load_turtle
from linked_fleet_rdf.vocabulary import INTEGERS, LF, NUMERIC, RDF, SH, XSD
from linked_fleet_state.robot_cache import RobotCache

_LIMITS = {
    SH.minInclusive: "minimum",
    SH.maxInclusive: "maximum",
    SH.minExclusive: "exclusiveMinimum",
    SH.maxExclusive: "exclusiveMaximum",
    SH.minLength: "minLength",
    SH.maxLength: "maxLength",
}
_TYPES: dict[NamedNode, Json] = {
    **{datatype: {"type": "number"} for datatype in NUMERIC},
    **{datatype: {"type": "integer"} for datatype in INTEGERS},
    XSD.string: {"type": "string"},
    XSD.boolean: {"type": "boolean"},
    XSD.dateTime: {"type": "string", "format": "date-time"},
    XSD.date: {"type": "string", "format": "date"},
    XSD.time: {"type": "string", "format": "time"},
    XSD.duration: {"type": "string", "format": "duration"},
    XSD.dayTimeDuration: {"type": "string", "format": "duration"},
    XSD.anyURI: {"type": "string", "format": "uri"},
}


def form_of(shape: NamedNode) -> Form:
    """Return the form of a shape in shapes/linked_fleet_shapes/blueprints.ttl or in the shapes of an extension."""
    return present().derived(("form", shape), lambda: _Reader(load_turtle(BLUEPRINTS)).form(shape))


_INPUTS = RobotCache[Form]()


def form_of_input(offer: Offer, base: str) -> Form:
    """Return the form of an action's input, with the limits of the thing that offers it."""
    if (declared := offer.input_form(base)) is not None:
        return declared
    robot = offer.robot
    joints = () if robot is None else robot.commanded
    known = None if robot is None else (robot.model, joints, robot.annotations)
    return _INPUTS.get(robot, known, (offer.path, base), lambda: _form_of_input(offer, base))


def _form_of_input(offer: Offer, base: str) -> Form:
    graph = Graph()
    node = offer.describe_input(graph, base)
    return form_in(graph.statements, node)


def form_of_target(offer: Offer, base: str) -> Form:
    """Return the form of the body of PUT that invokes ``offer``, such as the target property of a joint."""
    if (declared := offer.input_form(base)) is not None:
        return declared
    graph, iri = Graph(), NamedNode(base + offer.path)
    describe_target_input(graph, iri, offer, base)
    return form_in(graph.statements, iri)


def form_in(triples: Iterable[Triple | Statement], shape: Node) -> Form:
    """Return the JSON form of a shape described by triples."""
    by_subject: dict[Node, list[Triple | Statement]] = {}
    for triple in triples:
        subject, _, _ = triple
        by_subject.setdefault(subject, []).append(triple)
    return _Reader(by_subject).form(shape)


def term_text(term: Term) -> str:
    return term.value


class _Reader:
    """Reads the shapes of a graph, which may have many more: what is stated of each is grouped when it is read."""

    def __init__(self, shapes: Mapping[Node, Sequence[Triple | Statement]]) -> None:
        self._shapes = shapes
        self._stated: dict[Term, dict[NamedNode, list[Term]]] = {}

    def form(self, shape: Node, names: Mapping[NamedNode, str] | None = None) -> Form:
        """Return the form of a shape; ``names`` are inherited by a branch that does not repeat the names of its
        paths.
        """
        fields: dict[str, Field] = {}
        for node in (each for each in self._all(shape, SH.property) if isinstance(each, Node)):
            for found in self._fields(node, names or {}):
                fields.setdefault(found.name, found)
        branches: list[Form] = []
        for other in self._nodes(shape):
            inner = self.form(other, names)
            branches += inner.branches
            for found in inner.fields:
                fields.setdefault(found.name, found)
        known = {each.path[0]: each.name for each in fields.values() if len(each.path) == 1}
        branches += [self.form(each, known) for each in self._alternatives(shape) if self._all(each, SH.property)]
        return Form(tuple(fields.values()), tuple(branches))

    def _fields(self, node: Node, names: Mapping[NamedNode, str]) -> Iterator[Field]:
        path = self._one(node, SH.path)
        if not isinstance(path, NamedNode):
            return
        name = self._text(node, SH.name) or names.get(path)
        value = self._value(node)
        least, most = self._count(node, SH.minCount) or 0, self._count(node, SH.maxCount)
        if name is not None:
            # A branch adds constraints to a value; its cardinality is stated by the outer shape.
            most = 1 if path in names else most
            yield Field(name, (path,), value, least, most, self._text(node, SH.description) or "")
        elif value.form is not None and most == 1:
            for inner in value.form.fields:
                yield Field(
                    inner.name,
                    (path, *inner.path),
                    inner.value,
                    min(least, inner.min_count),
                    inner.max_count,
                    inner.description,
                )

    def _value(self, node: Node) -> Value:
        said = [node, *self._inner(node)]
        forms = [form for form in map(self.form, self._nodes(node)) if form.fields]
        if forms:
            return Value(form=forms[0])
        scalar: Json = {}
        terms: dict[str, Term] = {}
        unknown = False
        datatypes = [datatype for each in said for datatype in self._datatypes(each)]
        for each in said:
            for predicate, name in _LIMITS.items():
                if (text := self._text(each, predicate)) is not None:
                    scalar[name] = _number(text)
            for datatype in _most_general(self._datatypes(each)):
                scalar |= _TYPES.get(datatype, {})
            terms |= {term_text(term): term for term in self._listed(each)}
            unknown = unknown or any(self._one(other, SH.hasValue) == LF.unknown for other in self._alternatives(each))
            if self._one(each, SH.nodeKind) == SH.IRI:
                scalar |= {"type": "string", "format": "uri"}
        if terms:
            scalar |= {"type": "string", "enum": list(terms)}
        texts = {each for each in datatypes if each not in NUMERIC and each != XSD.boolean}
        any_text = len(texts) != 1 or XSD.string in texts or any(self._may_be_iri(each) for each in said)
        numeric = tuple(each for each in datatypes if each in NUMERIC)
        return Value(scalar, None, terms, unknown, None if any_text else texts.pop(), numeric)

    def _may_be_iri(self, node: Node) -> bool:
        return any(self._one(each, SH.nodeKind) == SH.IRI for each in (node, *self._alternatives(node)))

    def _inner(self, node: Node) -> Iterator[Node]:
        """Yield all further shapes that the values must conform to."""
        for each in self._nodes(node):
            yield each
            yield from self._inner(each)

    def _datatypes(self, node: Node) -> list[NamedNode]:
        stated = [self._one(each, SH.datatype) for each in (node, *self._alternatives(node))]
        return [each for each in stated if isinstance(each, NamedNode)]

    def _listed(self, node: Node) -> list[Term]:
        one = self._one(node, SH.hasValue)
        listed = [each for start in self._all(node, SH.in_) for each in self._list(start)]
        return [one, *listed] if one is not None else listed

    def _alternatives(self, node: Node) -> list[Node]:
        return [each for start in self._all(node, SH.or_) for each in self._list(start) if isinstance(each, Node)]

    def _nodes(self, node: Node) -> list[Node]:
        return [each for each in self._all(node, SH.node) if isinstance(each, Node)]

    def _list(self, start: Term) -> Iterator[Term]:
        while start != RDF.nil and isinstance(start, Node):
            first, rest = self._one(start, RDF.first), self._one(start, RDF.rest)
            if first is None or rest is None:
                return
            yield first
            start = rest

    def _all(self, node: Node, predicate: NamedNode) -> list[Term]:
        stated = self._stated.get(node)
        if stated is None:
            stated = self._stated[node] = {}
            for _, each, value in self._shapes.get(node, ()):
                stated.setdefault(each, []).append(value)
        return stated.get(predicate, [])

    def _one(self, node: Node, predicate: NamedNode) -> Term | None:
        return next(iter(self._all(node, predicate)), None)

    def _text(self, node: Node, predicate: NamedNode) -> str | None:
        found = self._one(node, predicate)
        return found.value if isinstance(found, Literal) else None

    def _count(self, node: Node, predicate: NamedNode) -> int | None:
        text = self._text(node, predicate)
        return None if text is None else int(text)


def _most_general(datatypes: Sequence[NamedNode]) -> Sequence[NamedNode]:
    """Return these datatypes, integers only if no other one is allowed."""
    return [each for each in datatypes if each not in INTEGERS] or datatypes


def _number(text: str) -> int | float:
    """Parse a limit with 14 digits: later ones only reflect its binary fraction."""
    value = float(f"{float(text):.14g}")
    return int(value) if value.is_integer() else value
