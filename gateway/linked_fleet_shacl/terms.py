"""The IRIs that the compiler knows, each spelt once, and the literals that shapes constrain.

An IRI that is not listed raises AttributeError. Literals are read by the lexical space of XML Schema 2, without white
space, and compared exactly across datatypes as in pySHACL: 0.1 as a double is a little more than 0.1 as a decimal, and
an xsd:float is not rounded to 32 bits. As in pySHACL, xsd:long and xsd:unsignedLong have no upper bound.
"""

import re
from calendar import monthrange
from collections.abc import Callable, Mapping
from decimal import Decimal

from pyoxigraph import BlankNode, Literal, NamedNode

Node = NamedNode | BlankNode
Term = NamedNode | BlankNode | Literal


class Namespace:
    """A closed set of terms under one IRI; attributes are NamedNodes."""

    def __init__(self, iri: str, terms: str) -> None:
        self.iri = iri
        self.terms = {term: NamedNode(iri + term) for term in terms.split()}

    def extended(self, terms: str) -> "Namespace":
        """Return the same namespace with further terms."""
        return Namespace(self.iri, " ".join((*self.terms, terms)))

    def __getattr__(self, term: str) -> NamedNode:
        try:
            found = self.terms[term.rstrip("_")]
        except KeyError:
            raise AttributeError(f"{self.iri} has no term {term!r} here") from None
        self.__dict__[term] = found  # so that this is called once for each term
        return found


RDF = Namespace("http://www.w3.org/1999/02/22-rdf-syntax-ns#", "type first rest nil langString")
RDFS = Namespace("http://www.w3.org/2000/01/rdf-schema#", "Class subClassOf")
XSD = Namespace(
    "http://www.w3.org/2001/XMLSchema#",
    "float double decimal integer int long short byte nonNegativeInteger positiveInteger nonPositiveInteger"
    " negativeInteger unsignedLong unsignedInt unsignedShort unsignedByte boolean string anyURI date dateTime",
)
SHACL = Namespace(
    "http://www.w3.org/ns/shacl#",
    # what the compiler understands
    "NodeShape PropertyShape path property node and or not xone minCount maxCount datatype nodeKind class in hasValue"
    " minInclusive minExclusive maxInclusive maxExclusive minLength maxLength pattern flags languageIn uniqueLang"
    " equals disjoint closed ignoredProperties"
    " qualifiedValueShape qualifiedMinCount qualifiedMaxCount qualifiedValueShapesDisjoint"
    " inversePath alternativePath zeroOrMorePath oneOrMorePath zeroOrOnePath"
    " name description order group defaultValue message severity deactivated parameter entailment"
    " target targetClass targetNode targetSubjectsOf targetObjectsOf"
    " IRI BlankNode Literal BlankNodeOrIRI BlankNodeOrLiteral IRIOrLiteral"
    # what a report says
    " Violation ValidationReport ValidationResult conforms result detail focusNode resultPath value"
    " sourceConstraintComponent sourceShape resultMessage resultSeverity"
    " MinCountConstraintComponent MaxCountConstraintComponent DatatypeConstraintComponent NodeKindConstraintComponent"
    " ClassConstraintComponent InConstraintComponent HasValueConstraintComponent MinInclusiveConstraintComponent"
    " MinExclusiveConstraintComponent MaxInclusiveConstraintComponent MaxExclusiveConstraintComponent"
    " MinLengthConstraintComponent MaxLengthConstraintComponent PatternConstraintComponent OrConstraintComponent"
    " AndConstraintComponent NotConstraintComponent XoneConstraintComponent NodeConstraintComponent"
    " QualifiedMinCountConstraintComponent QualifiedMaxCountConstraintComponent LanguageInConstraintComponent"
    " UniqueLangConstraintComponent EqualsConstraintComponent DisjointConstraintComponent ClosedConstraintComponent",
)
PREFIXES = {"rdf": RDF.iri, "rdfs": RDFS.iri, "xsd": XSD.iri, "sh": SHACL.iri}


Number = int | float | Decimal

_MOST_DIGITS = 4300  # of an integer; Python refuses to convert longer ones, whose time would grow quadratically
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
_BOOLEANS = ("true", "false", "1", "0")
_DAY = r"-?(?:[1-9][0-9]{3,}|0[0-9]{3})-(?:0[1-9]|1[0-2])-(?:0[1-9]|[12][0-9]|3[01])"
_CLOCK = r"(?:(?:[01][0-9]|2[0-3]):[0-5][0-9]:[0-5][0-9](?:\.[0-9]+)?|24:00:00(?:\.0+)?)"
_ZONE = r"(?:Z|[+-](?:(?:0[0-9]|1[0-3]):[0-5][0-9]|14:00))?"
_ANY_TEXT = (XSD.string, XSD.anyURI, RDF.langString)
_TIMES = {XSD.date: re.compile(_DAY + _ZONE), XSD.dateTime: re.compile(f"{_DAY}T{_CLOCK}{_ZONE}")}


def number(literal: Literal) -> Number | None:
    """Return the value of a well-typed number, including INF and NaN; None for other literals."""
    datatype, text = literal.datatype, literal.value
    if datatype in _INTEGERS:
        return _integer(text, *_INTEGERS[datatype])
    if datatype == XSD.decimal:
        return Decimal(text) if _DECIMAL.fullmatch(text) else None
    if datatype == XSD.float or datatype == XSD.double:
        return float(text) if _FLOAT.fullmatch(text) else None
    return None


def _integer(text: str, low: int | None, high: int | None) -> int | None:
    if len(text) > _MOST_DIGITS or not _INTEGER.fullmatch(text):
        return None
    value = int(text)
    return value if (low is None or low <= value) and (high is None or value <= high) else None


def well_typed(datatype: NamedNode) -> Callable[[Literal], bool] | None:
    """Return a test of a literal's lexical form; None for XML Schema or RDF types whose forms are unknown here."""
    if datatype == XSD.boolean:
        return lambda literal: literal.value in _BOOLEANS
    if datatype in _TIMES:
        return lambda literal: _is_time(literal.value, _TIMES[datatype])
    if datatype.value.startswith((XSD.iri, RDF.iri, RDFS.iri)) and datatype not in _ANY_TEXT:
        return None
    return lambda _: True


def _is_time(text: str, form: re.Pattern[str]) -> bool:
    """Return True if the date exists. Leap years repeat every 400 years, so that four digits of the year suffice."""
    if not form.fullmatch(text):
        return False
    year, month, day = text.removeprefix("-").split("-")[:3]
    return int(day[:2]) <= monthrange(2000 + int(year[-4:]) % 400, int(month))[1]
