"""Schemas of components as SHACL shapes, for people and for validators.

A shape accepts the RDF form of exactly those values that its schema accepts. In addition it accepts numbers in other
units of the same quantity and, for a property that is read, ``lf:unknown``.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

import msgspec
from msgspec import UNSET
from pyoxigraph import Literal, NamedNode

from linked_fleet_agent.wire.schema import MAX_ITEMS, MAX_TEXT, Schema
from linked_fleet_gateway.extensions.components.limits import (
    Range,
    forms_of,
    full_range,
    largest_range,
    stated_range,
)
from linked_fleet_gateway.extensions.components.places import Place
from linked_fleet_gateway.extensions.components.things import ThingSchema
from linked_fleet_gateway.extensions.components.units import accepted_units, declared_unit
from linked_fleet_rdf.graph import UNITLESS, Graph, Node, Term, Unit, integer
from linked_fleet_rdf.validation import COMMON_TYPES
from linked_fleet_rdf.vocabulary import LF, MATHS, NUMERIC, QUDT, RDF, UNIT, VOM, XSD
from linked_fleet_rdf.vocabulary import SH as _SH

SH = _SH.extended("closed ignoredProperties zeroOrMorePath oneOrMorePath pattern order defaultValue message BlankNode")
_TRUE = Literal("true", datatype=XSD.boolean)
_TYPES = sorted(COMMON_TYPES, key=str)
_OF_NUMBERS = (
    *("type", "unit", "enum", "const", "default", "minimum", "maximum", "exclusive_minimum", "exclusive_maximum"),
)
"""The members of a schema that decide the shape of a number."""
_BOOLEANS: Mapping[bool, tuple[str, str]] = {True: ("true", "1"), False: ("false", "0")}


class ShapeWriter:
    """Adds shapes to one graph. What several shapes have in common is in the graph once.

    Shapes ``of_output`` are of values that the gateway writes: in the declared unit, and possibly unknown.
    """

    def __init__(self, graph: Graph, *, of_output: bool = False) -> None:
        self._graph = graph
        self._of_output = of_output
        self._shared: dict[object, Node] = {}

    def object_shape(self, node: Node, place: Place) -> None:
        """Make ``node`` the shape of a node that has the members of an object, such as the input of an action."""
        self._graph.a(node, SH.NodeShape)
        self._among(self._property(node, RDF.type, most=None), _TYPES)
        self._members(node, place)

    def value_shape(self, node: Node, place: Place) -> None:
        """Make ``node`` also the shape of a node that has a value as its ``lf:value``."""
        self._graph.a(node, SH.NodeShape)
        value = self._property(node, LF.value, least=1)
        self._describe(value, place, "value")
        if self._of_output and place.schema.type not in ("number", "integer"):
            self._either_unknown(value, lambda known: self._constrain(known, place))
        else:
            self._constrain(value, place, may_be_unknown=self._of_output)

    def part_shape(self, node: Node, predicate: NamedNode, name: str, place: Place) -> None:
        """Make ``node`` also the shape of a node with a value: the members of an object, or an ``lf:value``."""
        inner = self._graph.blank()
        self._graph.add(self._property(node, predicate, name=name), SH.node, inner)
        (self.object_shape if place.schema.type == "object" else self.value_shape)(inner, place)

    def _either_unknown(self, node: Node, constrain: Callable[[Node], None]) -> None:
        known, unknown = self._graph.blank(), self._graph.blank()
        self._graph.add(unknown, SH.hasValue, LF.unknown)
        constrain(known)
        self._graph.add(node, SH.or_, self._graph.collection([unknown, known]))

    def _property(self, node: Node, path: Node, *, least: int = 0, most: int | None = 1, name: str = "") -> Node:
        shape = self._graph.blank()
        self._graph.add(node, SH.property, shape)
        self._cardinality(shape, path, least=least, most=most, name=name)
        return shape

    def _cardinality(self, shape: Node, path: Node, *, least: int = 0, most: int | None = 1, name: str = "") -> None:
        graph = self._graph
        graph.add(shape, SH.path, path)
        if name:
            graph.add(shape, SH.name, Literal(name))
        if least:
            graph.add(shape, SH.minCount, integer(int(least)))
        if most is not None:
            graph.add(shape, SH.maxCount, integer(most))

    def _describe(self, shape: Node, place: Place, name: str) -> None:
        """Add the name, which is that of the JSON form, and what people should know."""
        schema = place.schema
        self._graph.add(shape, SH.name, Literal(name))
        if said := ". ".join(each.rstrip(". ") for each in (schema.title, schema.description) if each):
            self._graph.add(shape, SH.description, Literal(said))
        if schema.default is not UNSET and schema.type in ("boolean", "string"):
            self._graph.add(shape, SH.defaultValue, *_literals([schema.default])[:1])

    def _constrain(self, node: Node, place: Place, *, may_be_unknown: bool = False) -> None:
        """Add the constraints on a value to a node shape or a property shape. A number can be unknown by itself."""
        match place.schema.type:
            case "boolean" | "string":
                self._text(node, place.schema)
            case "number" | "integer":
                self._quantity(node, place.schema, may_be_unknown=may_be_unknown)
            case "array":
                self._array(node, place)
            case "object":
                self._object(node, place)

    def _text(self, node: Node, schema: Schema) -> None:
        graph = self._graph
        if isinstance(schema, ThingSchema):
            graph.add(node, SH.nodeKind, SH.IRI)
        elif schema.type == "boolean":
            graph.add(node, SH.datatype, XSD.boolean)
        else:
            graph.add(node, SH.datatype, XSD.string)
            graph.add(node, SH.minLength, integer(schema.min_length or 0))
            graph.add(node, SH.maxLength, integer(_at_most(schema.max_length, MAX_TEXT)))
        if schema.pattern:
            graph.add(node, SH.pattern, Literal(schema.pattern))
        if (choices := _choices(schema)) is not None:
            self._among(node, _literals(choices))

    # -- numbers ------------------------------------------------------------------------------------------------------

    def _quantity(self, node: Node, schema: Schema, *, may_be_unknown: bool) -> None:
        key = (may_be_unknown, *(getattr(schema, each) for each in _OF_NUMBERS))
        quantity = self._once(key, lambda shape: self._number_with_unit(shape, schema, may_be_unknown))
        self._graph.add(node, SH.node, quantity)

    def _number_with_unit(self, quantity: Node, schema: Schema, may_be_unknown: bool) -> None:
        graph = self._graph
        units = (declared_unit(schema),) if self._of_output else accepted_units(schema)
        graph.add(quantity, SH.node, self._once(units, lambda shape: self._unit(shape, units)))
        limits = full_range(schema) if len(units) == 1 else largest_range(schema)
        key = (may_be_unknown, schema.type, schema.enum, schema.const, schema.default, *limits.items())
        value = self._once(key, lambda shape: self._numerical_value(shape, schema, limits, may_be_unknown))
        graph.add(quantity, SH.property, value)
        if len(units) > 1:
            branches = [self._in_unit(unit, stated_range(schema, units[0].si / unit.si)) for unit in units]
            graph.add(quantity, SH.or_, graph.collection(branches))

    def _numerical_value(self, value: Node, schema: Schema, limits: Range, may_be_unknown: bool) -> None:
        self._cardinality(value, VOM.numericalValue, least=1, name="value")
        if schema.default is not UNSET:
            self._graph.add(value, SH.defaultValue, forms_of(schema.default)[0])
        if may_be_unknown:
            self._either_unknown(value, lambda known: self._number(known, schema, limits))
        else:
            self._number(value, schema, limits)

    def _unit(self, shape: Node, units: tuple[Unit, ...]) -> None:
        """Accept the class of a scalar, which goes without saying, its unit, and the unit of QUDT beside it."""
        graph = self._graph
        graph.add(shape, SH.closed, _TRUE)
        graph.add(shape, SH.ignoredProperties, graph.collection([VOM.numericalValue]))
        self._among(self._property(shape, RDF.type), [MATHS.Scalar])
        unit = self._property(shape, VOM.unit, least=units[0] != UNITLESS, name="unit")
        self._among(unit, [iri for each in units for iri in each.accepted])
        if not self._of_output and units[0] != UNITLESS:
            graph.add(unit, SH.defaultValue, units[0].accepted[0])
        self._among(self._property(shape, QUDT.unit), [each.qudt for each in units])

    def _in_unit(self, unit: Unit, limits: Range) -> Node:
        branch = self._graph.blank()
        self._stated(branch, VOM.unit, unit.accepted)
        self._stated(branch, QUDT.unit, (unit.qudt,))
        if limits:
            name = f"value in {unit.qudt.value.removeprefix(UNIT.iri)}"
            self._range(self._property(branch, VOM.numericalValue, most=None, name=name), limits)
        return branch

    def _stated(self, branch: Node, path: NamedNode, terms: tuple[NamedNode, ...]) -> None:
        """Accept any number of these terms."""

        def write(shape: Node) -> None:
            self._cardinality(shape, path, most=None)
            self._among(shape, terms)

        self._graph.add(branch, SH.property, self._once((path, terms), write))

    def _number(self, node: Node, schema: Schema, limits: Range) -> None:
        if schema.type == "integer":
            self._graph.add(node, SH.datatype, XSD.integer)
        else:
            self._graph.add(node, SH.node, self._once("number", self._any_number))
        self._range(node, limits)
        if (choices := _choices(schema)) is not None:
            self._graph.add(node, SH.node, self._choice(choices))

    def _any_number(self, shape: Node) -> None:
        datatypes = [self._graph.blank() for _ in NUMERIC]
        for node, datatype in zip(datatypes, NUMERIC, strict=True):
            self._graph.add(node, SH.datatype, datatype)
        self._graph.add(shape, SH.message, Literal("must be a number"))
        self._graph.add(shape, SH.or_, self._graph.collection(datatypes))

    def _choice(self, choices: Sequence[float]) -> Node:
        """Compare by value: 1, 1.0 and 1e0 are one number and three terms."""
        shape, branches = self._graph.blank(), [self._graph.blank() for _ in choices]
        for branch, each in zip(branches, choices, strict=True):
            low, high = forms_of(each)
            self._range(branch, {SH.minInclusive: low, SH.maxInclusive: high})
        self._graph.add(shape, SH.message, Literal(f"must be one of {_shown(choices)}"))
        self._graph.add(shape, SH.or_ if choices else SH.in_, self._graph.collection(branches))
        return shape

    def _range(self, node: Node, limits: Range) -> None:
        for parameter, limit in limits.items():
            self._graph.add(node, parameter, limit)

    def _among(self, node: Node, terms: Sequence[Term]) -> None:
        self._graph.add(node, SH.in_, self._graph.collection(terms))

    # -- arrays and objects -------------------------------------------------------------------------------------------

    def _array(self, node: Node, place: Place) -> None:
        graph, schema = self._graph, place.schema
        assert place.items is not None
        graph.add(node, SH.node, self._once("list", self._list))
        least, most = schema.min_items or 0, _at_most(schema.max_items, MAX_ITEMS)
        # As many nodes as the list has items: the cells but the first, and rdf:nil.
        after = self._once(SH.oneOrMorePath, lambda path: graph.add(path, SH.oneOrMorePath, RDF.rest))
        count = self._property(node, after, least=least, most=most)
        graph.add(count, SH.message, Literal(f"{place.name}: {least} to {most} items are allowed"))
        each = self._property(node, self._once("items", self._item_path), most=None, name=f"an item of {place.name}")
        self._constrain(each, place.items)

    def _item_path(self, path: Node) -> None:
        graph = self._graph
        rest = graph.blank()
        graph.add(path, RDF.first, self._once(SH.zeroOrMorePath, self._cells))
        graph.add(path, RDF.rest, rest)
        graph.add(rest, RDF.first, RDF.first)
        graph.add(rest, RDF.rest, RDF.nil)

    def _cells(self, path: Node) -> None:
        self._graph.add(path, SH.zeroOrMorePath, RDF.rest)

    def _list(self, shape: Node) -> None:
        """Accept a list that ends and whose cells have one item and one rest each."""
        graph = self._graph
        cells = self._property(shape, self._once(SH.zeroOrMorePath, self._cells), most=None)
        nil, cell = graph.blank(), graph.blank()
        graph.add(cells, SH.message, Literal("must be an RDF list"))
        graph.add(cells, SH.hasValue, RDF.nil)
        graph.add(cells, SH.or_, graph.collection([nil, cell]))
        graph.add(nil, SH.hasValue, RDF.nil)
        for each, predicates in ((nil, ()), (cell, (RDF.first, RDF.rest))):
            graph.add(each, SH.closed, _TRUE)
            for predicate in predicates:
                self._property(each, predicate, least=1)

    def _object(self, node: Node, place: Place) -> None:
        shape = self._graph.blank()
        self._graph.add(node, SH.node, shape)
        self._graph.add(shape, SH.nodeKind, SH.BlankNode)
        self._members(shape, place)

    def _members(self, shape: Node, place: Place) -> None:
        """Accept the members of an object and nothing else."""
        self._graph.add(shape, SH.closed, _TRUE)
        for order, (name, member) in enumerate(place.members.items()):
            each = self._property(shape, member.predicate, least=name in place.schema.required)
            self._describe(each, member, name)
            self._graph.add(each, SH.order, integer(order))
            self._constrain(each, member)

    def _once(self, key: object, write: Callable[[Node], None]) -> Node:
        """Return the node with this key, which is written when it is needed first."""
        if key not in self._shared:
            self._shared[key] = self._graph.blank()
            write(self._shared[key])
        return self._shared[key]


def _choices(schema: Schema) -> list[Any] | None:
    """Return the values that ``enum`` and ``const`` leave; None if there is neither."""
    if schema.const is UNSET:
        return list(schema.enum) or None
    return [schema.const] if not schema.enum or schema.const in schema.enum else []


def _literals(values: Iterable[Any]) -> list[Literal]:
    """Return the terms of texts and booleans; a boolean has two."""
    found = []
    for each in values:
        forms = _BOOLEANS[each] if isinstance(each, bool) else ()
        found += [Literal(text, datatype=XSD.boolean) for text in forms] or [Literal(each)]
    return found


def _at_most(stated: int | None, most: int) -> int:
    return most if stated is None else min(stated, most)


def _shown(choices: Sequence[float]) -> str:
    return msgspec.json.encode(choices).decode()[1:-1].replace(",", ", ")
