"""Plain JSON of resources and bodies, by the form of their SHACL shape (``resources.json_form``).

A JSON body is converted to the equivalent RDF triples and then handled like RDF.
"""

import json
import math
import re
from collections.abc import Callable, Iterator, Sequence
from decimal import Decimal
from functools import partial
from typing import Any

from pyoxigraph import BlankNode, Literal, NamedNode, RdfFormat, Triple, parse

from linked_fleet_base.errors import BadRequest, PayloadTooLarge, UnprocessableContent
from linked_fleet_gateway.resources.form import Field, Form, Json, Value
from linked_fleet_gateway.resources.json_form import form_of
from linked_fleet_gateway.resources.resource import Resource
from linked_fleet_rdf.graph import Graph, Node, Term
from linked_fleet_rdf.json_input import ParseError, load_json
from linked_fleet_rdf.parsing import MAX_LENGTH
from linked_fleet_rdf.serialise import JSON
from linked_fleet_rdf.vocabulary import INTEGERS, LF, NUMERIC, XSD

_MAX_DEPTH = 16
_OUTPUT_DEPTH = 4
_WHOLE = re.compile(r"-?[0-9]+\.0+")
_MAX_DIGITS = 40  # of a number that is written without its exponent
_VALUES = 4  # JSON values for each permitted triple


def add_plain_json(resource: Resource, shape: NamedNode, base: str) -> Resource:
    """Return the resource with a plain JSON representation, if ``shape`` defines one."""
    if resource.describe is None or shape == LF.AnnotationsShape:
        return resource
    write = partial(json_document, resource.describe, NamedNode(base + resource.path), shape)
    return resource.replace(documents={**resource.documents, JSON: write})


def json_document(describe: Callable[[Graph], None], iri: NamedNode, shape: NamedNode) -> bytes:
    """Return a description in JSON; ``null`` means unknown."""
    graph = Graph()
    describe(graph)
    return node_json(graph.triples, iri, shape)


def node_json(triples: Sequence[Triple], node: Node, shape: NamedNode) -> bytes:
    """Return the statements about a node in JSON."""
    return json.dumps(_JsonWriter(triples).object(form_of(shape), node), ensure_ascii=False, allow_nan=False).encode()


def description_json(describe: Callable[[Graph], None], iri: NamedNode, shape: NamedNode) -> Json:
    graph = Graph()
    describe(graph)
    return _JsonWriter(graph.triples).object(form_of(shape), iri)


def stored_json(stored: str, root: BlankNode) -> Json:
    """Return statements, stored in N-Triples, about a node in JSON, by the local names of their predicates.

    They have no shape, so that a predicate with several values is an array, and one with a single value is not. Blank
    nodes are objects, other nodes their IRIs.
    """
    return _JsonWriter([each.triple for each in parse(stored, format=RdfFormat.N_TRIPLES)]).unshaped(root)


class _JsonWriter:
    """Converts triples to JSON."""

    def __init__(self, triples: Sequence[Triple]) -> None:
        self._objects: dict[tuple[object, NamedNode], list[Term]] = {}
        for triple in triples:
            self._objects.setdefault((triple.subject, triple.predicate), []).append(triple.object)  # type: ignore[arg-type]

    def object(self, form: Form, node: Node) -> Json:
        told: Json = {}
        for field in form.fields:
            values = [self._value(field.value, each) for each in self._at(node, field.path)]
            if not field.is_single:
                told[field.name] = values
            elif values:
                told[field.name] = values[0]
        return told

    def unshaped(self, node: Term, depth: int = _OUTPUT_DEPTH) -> Json:
        """Return all statements about a node, by the local names of their predicates."""
        told: Json = {}
        for (subject, predicate), objects in self._objects.items():
            if subject == node:
                values = [self._unshaped_value(each, depth) for each in objects]
                name = re.split("[#/]", predicate.value)[-1] or predicate.value
                told[predicate.value if name in told else name] = values[0] if len(values) == 1 else values
        return told

    def _unshaped_value(self, term: Term, depth: int) -> Any:
        if isinstance(term, BlankNode):
            return self.unshaped(term, depth - 1) if depth else None
        if isinstance(term, Literal) and term.datatype in INTEGERS:
            return int(term.value)
        return self._value(_ANY, term)

    def _at(self, node: Term, path: tuple[NamedNode, ...]) -> list[Term]:
        nodes = [node]
        for predicate in path:
            nodes = [found for each in nodes for found in self._objects.get((each, predicate), ())]
        return nodes

    def _value(self, value: Value, term: Term) -> Any:
        if value.form is not None and not isinstance(term, Literal):
            return self.object(value.form, term)
        if isinstance(term, Literal) and term.datatype in NUMERIC:
            number = float(term.value)
            return (int(number) if value.scalar.get("type") == "integer" else number) if math.isfinite(number) else None
        if isinstance(term, Literal) and term.datatype == XSD.boolean:
            return term.value in ("true", "1")
        return None if term == LF.unknown and value.nullable else term.value


def _number_literal(text: str, allowed: Sequence[NamedNode]) -> Literal:
    """Return a number as the shape wants it: an integer or a double if it may be, else of its first datatype."""
    whole = text.lstrip("-").isdecimal()
    usual = XSD.integer if whole else XSD.double
    datatype = usual if not allowed or usual in allowed else allowed[0]
    if datatype in INTEGERS and not whole and _WHOLE.fullmatch(text):
        return Literal(text.partition(".")[0], datatype=datatype)  # 3.0 is 3 in JSON
    if datatype == XSD.decimal and abs((number := Decimal(text)).adjusted()) <= _MAX_DIGITS:
        return Literal(f"{number:f}", datatype=datatype)  # it has no exponent
    return Literal(text, datatype=datatype)


_ANY = Value()


class _Number(str):
    """A number as written in JSON: the validator must see numbers beyond the range of a float."""

    __slots__ = ()


def parse_json_body(body: bytes, form: Form, iri: str, max_triples: int) -> list[Triple]:
    """Convert a JSON body to triples about a blank node, not yet validated by the shape.

    Raises BadRequest for invalid JSON, PayloadTooLarge, UnprocessableContent for members without a name in the form.
    """
    given = _parsed(body, max_triples)
    if not isinstance(given, dict):
        raise UnprocessableContent("The body is a JSON object.", constraint=iri)
    taker = _JsonReader(iri, max_triples)
    taker.object(form, given, "")
    return taker.triples


def _parsed(body: bytes, most: int) -> Any:
    try:
        return load_json(body.decode("utf-8-sig"), _MAX_DEPTH, most * _VALUES, _Number)
    except ParseError as error:
        raise BadRequest(f"The body is no {JSON}: {error}", line=error.line, column=error.column) from error
    except UnicodeDecodeError as error:
        raise BadRequest(f"The body is no {JSON}: not UTF-8") from error


class _JsonReader:
    """Converts JSON to triples."""

    def __init__(self, iri: str, most: int) -> None:
        self.triples: list[Triple] = []
        self._iri, self._most = iri, most

    def object(self, form: Form, given: Json, where: str) -> BlankNode:
        node = BlankNode()
        between: dict[tuple[NamedNode, ...], BlankNode] = {(): node}
        for name, value in given.items():
            field = form.by_name.get(name)
            if field is None:
                known = ", ".join(form.by_name) or "none"
                raise self._refused(f"{where}{name}"[:100], f"is not known; there are {known}")
            for each in self._values(field, value, where + name):
                self._add(self._before(field.path[:-1], between), field.path[-1], each)
        return node

    def _before(self, path: tuple[NamedNode, ...], between: dict[tuple[NamedNode, ...], BlankNode]) -> BlankNode:
        """Return the node at the end of ``path``, which members of one object share."""
        if path not in between:
            between[path] = BlankNode()
            self._add(self._before(path[:-1], between), path[-1], between[path])
        return between[path]

    def _add(self, subject: BlankNode, predicate: NamedNode, value: Term) -> None:
        if len(self.triples) == self._most:
            raise PayloadTooLarge(f"The body says more than {self._most} things.")
        self.triples.append(Triple(subject, predicate, value))

    def _values(self, field: Field, value: Any, where: str) -> Iterator[Term]:
        if field.is_single:
            yield self._term(field.value, value, where)
            return
        if not isinstance(value, list):
            raise self._refused(where, "is an array")
        for index, each in enumerate(value):
            yield self._term(field.value, each, f"{where}[{index}]")

    def _term(self, value: Value, given: Any, where: str) -> Term:
        """Return the term for a JSON value. Literals keep their text, because the shape validates them."""
        if value.form is not None:
            if not isinstance(given, dict):
                raise self._refused(where, "is an object")
            return self.object(value.form, given, where + ".")
        if isinstance(given, bool):
            return Literal("true" if given else "false", datatype=XSD.boolean)
        if not isinstance(given, str) or len(given) > MAX_LENGTH:
            raise self._refused(where, f"is one number, or one text of at most {MAX_LENGTH} characters")
        if isinstance(given, _Number):
            return _number_literal(str(given), value.numeric)
        if given in value.terms:
            return value.terms[given]
        if value.is_iri:
            return self._iri_of(given, where)
        return Literal(given) if value.datatype is None else Literal(given, datatype=value.datatype)

    def _iri_of(self, text: str, where: str) -> NamedNode:
        try:
            return NamedNode(text)
        except ValueError as error:
            raise self._refused(where, "is an absolute IRI") from error

    def _refused(self, where: str, what: str) -> UnprocessableContent:
        return UnprocessableContent(f"{where} {what}.", constraint=self._iri)
