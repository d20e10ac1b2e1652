"""What a compiled shape looks at: the triples of one body by subject and predicate, and the numbers in its literals.

A literal is read by the lexical space of XML Schema 2, in which there is no white space, and compared as pySHACL
compares: exactly, whatever the two types are, so that 0.1 as a double (which is a little more) exceeds 0.1 as a
decimal, and an xsd:float is not rounded to 32 bits. As in pySHACL an xsd:long or xsd:unsignedLong has no upper end.
"""

import math
import re
from collections.abc import Callable, Collection, Mapping, Sequence
from decimal import Decimal

from pyoxigraph import Literal, NamedNode, Triple

from gateway.rdf.graph import Term
from gateway.rdf.vocabulary import XSD

Number = int | float | Decimal
Reach = Callable[["Data", Term], Collection[Term]]

_MOST_DIGITS = 4300  # of an integer, above which Python refuses to convert it: the time grows with the square
_INTEGER = re.compile(r"[+-]?[0-9]+")
_DECIMAL = re.compile(r"[+-]?(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)")
_FLOAT = re.compile(r"(?:[+-]?(?:(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][+-]?[0-9]+)?|INF)|NaN)")
_INTEGERS: Mapping[NamedNode, tuple[int | None, int | None]] = {
    XSD.integer: (None, None),
    XSD.long: (None, None),
    XSD.int: (-(2**31), 2**31 - 1),
    XSD.short: (-(2**15), 2**15 - 1),
    XSD.byte: (-(2**7), 2**7 - 1),
    XSD.nonNegativeInteger: (0, None),
    XSD.positiveInteger: (1, None),
    XSD.nonPositiveInteger: (None, 0),
    XSD.negativeInteger: (None, -1),
    XSD.unsignedLong: (0, None),
    XSD.unsignedInt: (0, 2**32 - 1),
    XSD.unsignedShort: (0, 2**16 - 1),
    XSD.unsignedByte: (0, 2**8 - 1),
}
NUMERIC = frozenset((*_INTEGERS, XSD.decimal, XSD.float, XSD.double))


class Data:
    """The triples of a body, each once (by RDF term equality), and what was found out about them."""

    def __init__(self, triples: Sequence[Triple]) -> None:
        self._forward: dict[object, dict[NamedNode, list[Term]]] = {}
        self._backward: dict[tuple[object, NamedNode], list[Term]] | None = None
        self._numbers: dict[Literal, Number | None] = {}
        self.verdicts: dict[tuple[object, Term], bool] = {}  # by shape and focus: nobody is judged twice by one shape
        for triple in dict.fromkeys(triples):
            about = self._forward.setdefault(triple.subject, {})
            about.setdefault(triple.predicate, []).append(triple.object)  # type: ignore[arg-type]

    def objects(self, subject: Term, predicate: NamedNode) -> Sequence[Term]:
        about = self._forward.get(subject)
        return about.get(predicate, ()) if about else ()

    def subjects(self, predicate: NamedNode, value: Term) -> Sequence[Term]:
        if self._backward is None:
            self._backward = {}
            for subject, about in self._forward.items():
                for each, values in about.items():
                    for found in values:
                        self._backward.setdefault((found, each), []).append(subject)  # type: ignore[arg-type]
        return self._backward.get((value, predicate), ())

    def number(self, literal: Literal) -> Number | None:
        """The value of a well-typed number; None for any other literal."""
        try:
            return self._numbers[literal]
        except KeyError:
            value = self._numbers[literal] = number(literal)
            return value


def number(literal: Literal) -> Number | None:
    """The value of a well-typed number, INF and NaN included; None for any other literal."""
    datatype, text = literal.datatype, literal.value
    if datatype in _INTEGERS:
        return _integer(text, *_INTEGERS[datatype])
    if datatype == XSD.decimal:
        return Decimal(text) if _DECIMAL.fullmatch(text) else None
    if datatype == XSD.float or datatype == XSD.double:
        return float(text) if _FLOAT.fullmatch(text) else None
    return None


def comparable(term: Term, data: Data) -> Number | None:
    """The number that limits are about; None for what has no place among the numbers, NaN too."""
    if not isinstance(term, Literal):
        return None
    value = data.number(term)
    return None if isinstance(value, float) and math.isnan(value) else value


def _integer(text: str, low: int | None, high: int | None) -> int | None:
    if len(text) > _MOST_DIGITS or not _INTEGER.fullmatch(text):
        return None
    value = int(text)
    return value if (low is None or low <= value) and (high is None or value <= high) else None


def predicate_path(predicate: NamedNode) -> Reach:
    return lambda data, focus: data.objects(focus, predicate)


def inverse_path(predicate: NamedNode) -> Reach:
    return lambda data, focus: data.subjects(predicate, focus)


def sequence_path(steps: Sequence[Reach]) -> Reach:
    def reach(data: Data, focus: Term) -> Collection[Term]:
        found: Collection[Term] = (focus,)
        for step in steps:
            found = dict.fromkeys(value for each in found for value in step(data, each))
        return found

    return reach


def alternative_path(ways: Sequence[Reach]) -> Reach:
    return lambda data, focus: dict.fromkeys(value for way in ways for value in way(data, focus))


def optional_path(step: Reach) -> Reach:
    return lambda data, focus: dict.fromkeys((focus, *step(data, focus)))


def repeated_path(step: Reach, *, with_focus: bool) -> Reach:
    """``sh:zeroOrMorePath``, or ``sh:oneOrMorePath``: what repeated steps lead to, each node once."""

    def reach(data: Data, focus: Term) -> Collection[Term]:
        found: dict[Term, None] = {focus: None} if with_focus else {}
        pending = list(step(data, focus))
        while pending:
            node = pending.pop()
            if node not in found:
                found[node] = None
                pending.extend(step(data, node))
        return found

    return reach
