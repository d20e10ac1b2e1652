"""Typed values of a validated body, in SI units. The shape guarantees that required values exist."""

import re
from collections.abc import Sequence

from pyoxigraph import BlankNode, Literal, NamedNode, RdfFormat, Triple, serialize

from linked_fleet_gateway.base.errors import UnprocessableContent
from linked_fleet_gateway.rdf.graph import Node
from linked_fleet_gateway.rdf.units import UNITS
from linked_fleet_gateway.rdf.unused import renamed, subjects
from linked_fleet_gateway.rdf.vocabulary import HYBRIT, LDP, LF, MATHS, PROV, RDF, ROS, SH, SOSA, SPATIAL, VOM
from linked_fleet_gateway.resources.invocation import ROOT

_MAX_REMEMBERED = 32 * 1024  # characters; a longer body is executed but not shown with the invocation
_OURS = tuple(each.iri for each in (HYBRIT, LDP, LF, MATHS, PROV, ROS, SH, SOSA, SPATIAL, VOM))
_NOT_ZERO = re.compile(r"[^eE]*[1-9]")  # a non-zero digit before the exponent


class Body:
    """The triples of a body by subject and predicate, and its root node."""

    def __init__(self, triples: Sequence[Triple], root: Node) -> None:
        self.root = root
        self.triples = triples
        self._values: dict[tuple[Node, NamedNode], list[Node | Literal]] = {}
        for triple in dict.fromkeys(triples):
            self._values.setdefault((triple.subject, triple.predicate), []).append(triple.object)  # type: ignore[arg-type]

    def nodes(self, subject: Node, predicate: NamedNode) -> list[Node]:
        return [each for each in self._values.get((subject, predicate), ()) if isinstance(each, NamedNode | BlankNode)]

    def node(self, subject: Node, predicate: NamedNode) -> Node | None:
        return next(iter(self.nodes(subject, predicate)), None)

    def text(self, subject: Node, predicate: NamedNode) -> str | None:
        found = self._values.get((subject, predicate), ())
        return next((each.value for each in found if isinstance(each, Literal)), None)

    def number(self, subject: Node, predicate: NamedNode, unit: float = 1.0) -> float | None:
        """Return a number in ``unit`` converted to SI.

        Raises UnprocessableContent for a non-zero number that a float rounds to zero: a shape accepts a speed of
        1e-400, but zero would mean something else.
        """
        text = self.text(subject, predicate)
        try:
            value = None if text is None else float(text) * unit
        except ValueError as error:  # if no shape has validated it
            raise UnprocessableContent(f"{text!r:.80} of {predicate.value} is no number.") from error
        if text is not None and value == 0.0 and _NOT_ZERO.match(text):
            raise UnprocessableContent(f"{text[:80]} of {predicate.value} is too near zero; write 0 or more.")
        return value

    def unit(self, subject: Node) -> float:
        """Return the SI size of the unit that ``subject`` states; 1 without a unit."""
        unit = self.node(subject, VOM.unit)
        return UNITS[unit].si if isinstance(unit, NamedNode) else 1.0

    def quantity(self, subject: Node) -> float:
        """Return ``vom:numericalValue`` converted to the SI unit."""
        value = self.number(subject, VOM.numericalValue, self.unit(subject))
        assert value is not None
        return value


def own_part(triples: Sequence[Triple], root: Node) -> list[Triple]:
    """Return the triples about the root and about the blank nodes that it leads to."""
    by_subject = subjects(triples)
    found: list[Triple] = []
    pending, done = [root], set[Node]()
    while pending:
        node = pending.pop()
        if node in done:
            continue
        done.add(node)
        found += by_subject.get(node, ())
        pending += [t.object for t in by_subject.get(node, ()) if isinstance(t.object, BlankNode)]
    return found


def as_ntriples(body: Body) -> str:
    """Return the triples about the root and the blank nodes below it, as N-Triples about ``_:input``.

    Empty if it is too long to store. Types of our own vocabularies are omitted: they follow from the position of a
    node, and a validator would take a part of an input for a thing.
    """
    about = [triple for triple in own_part(body.triples, body.root) if not _is_type(triple)]
    written = serialize(renamed(about, body.root, ROOT), format=RdfFormat.N_TRIPLES)
    assert written is not None  # None only when it writes to a file
    return written.decode() if len(written) <= _MAX_REMEMBERED else ""


def _is_type(triple: Triple) -> bool:
    value = triple.object
    return triple.predicate == RDF.type and isinstance(value, NamedNode) and value.value.startswith(_OURS)
