"""Values in descriptions: numbers with units, found without knowing the predicates that lead to them."""

from collections.abc import Iterator
from dataclasses import dataclass
from datetime import UTC, datetime

from rdflib import XSD, Graph
from rdflib.term import BNode, Literal, Node, URIRef

from linked_fleet_client.quantity import NUMBERS, UNIT_PATHS, UNITS, Quantity, number
from linked_fleet_client.vocabulary import DCTERMS, HYBRIT, LDP, LF, PROV, RDF, RDFS, SOSA, local_name

Value = Quantity | str | URIRef | bool
_TIMES = (SOSA.resultTime, PROV.generatedAtTime, DCTERMS.modified)
# Vocabularies of statements about a property that are no values of it.
_ABOUT = (str(HYBRIT), str(DCTERMS), str(RDFS), str(RDF), str(LDP), str(SOSA))
_ABOUT_TERMS = frozenset({LF.version, LF.previousVersion, LF.eventId, *UNIT_PATHS})
_DEEPEST = 6
_MOST = 20_000


@dataclass(frozen=True)
class Reading:
    """Values by the path of predicates that leads to them, such as ``position.x``; ``scalars`` are those with a unit.
    Items of lists have their number, as ``sequence[0]``.

    A number that the server says is unknown is a Quantity without number.
    """

    values: dict[str, Value]
    scalars: tuple[str, ...]

    @property
    def main(self) -> Quantity | None:
        """The quantity of a resource that has exactly one."""
        quantities = {key: value for key, value in self.values.items() if isinstance(value, Quantity)}
        if len(self.scalars) == 1:
            return quantities[self.scalars[0]]
        return next(iter(quantities.values())) if len(quantities) == 1 else None


def read(graph: Graph, subject: Node) -> Reading:
    """Return all values below ``subject``: in its own statements and in those of blank nodes that they lead to."""
    found: dict[str, Value] = {}
    scalars: list[str] = []
    for key, value, scalar in _walk(graph, subject, "", _time(graph, subject, None), (subject,)):
        if len(found) >= _MOST:
            break
        found[key] = value
        scalars += [key] if scalar else []
    return Reading(found, tuple(scalars))


def _walk(
    graph: Graph, node: Node, key: str, time: datetime | None, above: tuple[Node, ...]
) -> Iterator[tuple[str, Value, bool]]:
    unit = _unit(graph, node)
    for predicate, objects in _by_predicate(graph, node):
        many = len(objects) > 1
        for index, value in enumerate(objects):
            scalar = predicate in NUMBERS and bool(key)
            name = key if scalar else f"{key}.{local_name(str(predicate))}".lstrip(".")
            name += f"[{_label(graph, value) or index}]" if many else ""
            for item_name, item in _items(graph, value, name):
                if isinstance(item, BNode):
                    if item not in above and len(above) < _DEEPEST:
                        yield from _walk(graph, item, item_name, _time(graph, item, time), (*above, item))
                elif (said := _value(item, unit or _own_unit(graph, node, predicate), time)) is not None:
                    yield item_name, said, predicate in NUMBERS


def _items(graph: Graph, value: Node, name: str, depth: int = 0) -> Iterator[tuple[str, Node]]:
    """Yield the items of an RDF list with their names, as ``sequence[0]``; anything else as it is."""
    if value != RDF.nil and (value, RDF.first, None) not in graph:
        yield name, value
        return
    cell: Node | None = value
    for index in range(_MOST if depth < _DEEPEST else 0):
        item = graph.value(cell, RDF.first)
        if item is None:
            return
        yield from _items(graph, item, f"{name}[{index}]", depth + 1)
        cell = graph.value(cell, RDF.rest)


def _by_predicate(graph: Graph, node: Node) -> list[tuple[Node, list[Node]]]:
    """Return the statements about the node in an order that does not depend on the graph's."""
    found: dict[Node, list[Node]] = {}
    units = {unit for predicate in set(graph.predicates(node)) if (unit := URIRef(f"{predicate}Unit"))}
    for predicate, value in graph.predicate_objects(node):
        if predicate not in _ABOUT_TERMS and predicate not in units and not str(predicate).startswith(_ABOUT):
            found.setdefault(predicate, []).append(value)
    return [
        (key, sorted(found[key], key=lambda value: _label(graph, value) or str(value)))
        for key in sorted(found, key=str)
    ]


def _value(term: Node, unit: URIRef | None, time: datetime | None) -> Value | None:
    if term == LF.unknown:
        return Quantity(None, unit and str(unit), time)
    if isinstance(term, Literal) and term.datatype == XSD.boolean and isinstance(term.toPython(), bool):
        return bool(term.toPython())
    if isinstance(term, Literal):
        value = number(term)
        return Quantity(value, unit and str(unit), time) if value is not None else str(term)
    return term if isinstance(term, URIRef) else None


def _unit(graph: Graph, node: Node) -> URIRef | None:
    stated = sorted(
        value for predicate in UNIT_PATHS for value in graph.objects(node, predicate) if isinstance(value, URIRef)
    )
    return next((unit for unit in stated if str(unit) in UNITS), next(iter(stated), None))


def _own_unit(graph: Graph, node: Node, predicate: Node) -> URIRef | None:
    """Return the unit of one predicate among several, as in a sample of a joint: predicate IRI plus ``Unit``."""
    unit = graph.value(node, URIRef(f"{predicate}Unit"))
    return unit if isinstance(unit, URIRef) else None


def _label(graph: Graph, node: Node) -> str:
    """Return a label that distinguishes several nodes: the single resource that the node points to."""
    if not isinstance(node, BNode):
        return ""
    units = {URIRef(f"{predicate}Unit") for predicate in graph.predicates(node)}
    pointed = [
        value
        for predicate, value in graph.predicate_objects(node)
        if isinstance(value, URIRef)
        and predicate != RDF.type
        and predicate not in units
        and predicate not in UNIT_PATHS
        and value != LF.unknown
    ]
    return local_name(pointed[0]) if len(pointed) == 1 else ""


def _time(graph: Graph, node: Node, above: datetime | None) -> datetime | None:
    stated = (date_time(graph.value(node, predicate)) for predicate in _TIMES)
    return next((found for found in stated if found is not None), above)


def date_time(term: Node | None) -> datetime | None:
    """Return the time in a literal, with UTC as default time zone; None if it is not a dateTime."""
    if not isinstance(term, Literal):
        return None
    value = term.toPython()
    if not isinstance(value, datetime):
        return None
    return value if value.tzinfo else value.replace(tzinfo=UTC)
