"""Checks of request bodies that shapes do not cover: the root node, and lexical forms of numbers and predicates."""

import math
import re
from collections.abc import Sequence

from pyoxigraph import Literal, NamedNode, Triple

from linked_fleet_gateway.base.errors import UnprocessableContent
from linked_fleet_gateway.rdf.graph import Node
from linked_fleet_gateway.rdf.vocabulary import NUMERIC, XSD

# The lexical spaces of XML Schema 2, 3.2 and 3.3 (RDF 1.1 Concepts, 5.1), without white space, which only XML
# collapses. Python's float accepts more, such as 1_0.
_INTEGER = re.compile(r"[+-]?[0-9]+")
_DECIMAL = re.compile(r"[+-]?(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)")
_FLOAT = re.compile(r"[+-]?(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][+-]?[0-9]+)?")
_LEXICAL = {XSD.decimal: _DECIMAL, XSD.float: _FLOAT, XSD.double: _FLOAT}
_XML_NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_.-]*\Z")


def root(body: Sequence[Triple], request: NamedNode) -> Node:
    """Return ``<>``, else the only subject that is not an object (DESIGN: "body of an action")."""
    subjects = dict.fromkeys(t.subject for t in body)
    if request in subjects:
        return request
    objects = {t.object for t in body}
    roots = [s for s in subjects if s not in objects]
    if len(roots) != 1:
        found = "no triples" if not body else f"{len(roots)} subjects that nobody refers to"
        raise UnprocessableContent(
            f"The body has {found}; it needs one root: <> (the request URI), or the only subject "
            "that is nobody's object.",
            constraint=request.value,
        )
    return roots[0]  # type: ignore[return-value]


def check_writable(triples: Sequence[Triple], constraint: str) -> None:
    """Raise UnprocessableContent for a predicate without an XML name, which could not be read as RDF/XML."""
    unwritable = [t.predicate.value for t in triples if not _XML_NAME.search(t.predicate.value)]
    if unwritable:
        raise UnprocessableContent(
            f"RDF/XML cannot say <{unwritable[0][:200]}>: a predicate ends in a name, such as label or isOwnedBy.",
            constraint=constraint,
        )


def check_lexical_forms(body: Sequence[Triple], constraint: str) -> None:
    for triple in body:
        literal = triple.object
        if isinstance(literal, Literal) and literal.datatype in NUMERIC:
            lexical = _LEXICAL.get(literal.datatype, _INTEGER).fullmatch(literal.value)
            if not lexical or not math.isfinite(float(literal.value)):
                raise UnprocessableContent(
                    f"{literal.value[:80]!r} is no finite number of type {literal.datatype.value}; write e.g. 43.6.",
                    constraint=constraint,
                )
