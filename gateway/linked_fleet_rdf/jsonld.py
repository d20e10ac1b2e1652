"""A JSON-LD 1.1 writer: compact, nested, with a context of exactly the prefixes in use.

JSON-LD 1.1, sections 4.1.5 (compact IRIs), 4.2 (typed values, language), 4.3.1 (lists), and the JSON-LD API's section
8.6 (conversion of native numbers and booleans to literals).
"""

import json
import math
import re
from collections.abc import Mapping, Sequence
from typing import Any

from pyoxigraph import BlankNode, Literal, NamedNode, Triple

from linked_fleet_rdf.turtle import TYPE, XSD, Names, Outline, Properties, Subject, Term

_INTEGER = re.compile(r"0|-?[1-9][0-9]{0,14}")
_DOUBLE = re.compile(r"(-?[0-9]\.[0-9]+)E(-?[0-9]{1,2})")
_SCHEME = re.compile(r"([^:/?#]+):(?!//)")


def write_jsonld(triples: Sequence[Triple], prefixes: Mapping[str, str]) -> str:
    """Return one node object if there is one subject, else ``@graph``."""
    writer = _Writer(Outline(triples), Names(_unambiguous(prefixes, triples)))
    nodes = [writer.heading(subject) for subject in writer.outline.headings]
    context = {"@context": dict(sorted(writer.names.used.items()))}
    if len(nodes) == 1:
        return json.dumps(context | nodes[0], ensure_ascii=False)
    # Node by node, because json holds the interpreter for all that it writes at once.
    graph = ", ".join([json.dumps(node, ensure_ascii=False) for node in nodes])
    return f'{json.dumps(context, ensure_ascii=False)[:-1]}, "@graph": [{graph}]}}'


def _unambiguous(prefixes: Mapping[str, str], triples: Sequence[Triple]) -> dict[str, str]:
    """Drop prefixes that equal the scheme of an IRI in the data: ``unit:x`` would be expanded."""
    schemes = {match[1] for triple in triples for iri in _iris(triple) if (match := _SCHEME.match(iri))}
    return {prefix: namespace for prefix, namespace in prefixes.items() if prefix and prefix not in schemes}


def _iris(triple: Triple) -> list[str]:
    value = triple.object
    terms = (triple.subject, triple.predicate, value.datatype if isinstance(value, Literal) else value)
    return [term.value for term in terms if isinstance(term, NamedNode)]


class _Writer:
    def __init__(self, outline: Outline, names: Names) -> None:
        self.outline = outline
        self.names = names

    def heading(self, subject: Subject) -> dict[str, Any]:
        identity = {} if self.outline.is_anonymous(subject) else {"@id": self._identifier(subject)}
        return identity | self._properties(self.outline.properties[subject])

    def _properties(self, properties: Properties) -> dict[str, Any]:
        members: dict[str, Any] = {}
        types = [value for value in properties.get(TYPE, ()) if isinstance(value, NamedNode)]
        if types:
            members["@type"] = _single([self._iri(value) for value in types])
        for predicate, values in properties.items():
            # `@type` accepts IRIs only; other types are written as an ordinary property
            rest = [v for v in values if not isinstance(v, NamedNode)] if predicate == TYPE else values
            if rest:
                members[self._iri(predicate)] = _single([self._value(value) for value in rest])
        return members

    def _value(self, term: Term) -> Any:
        items = self.outline.list_items(term)
        if items is not None:
            return {"@list": [self._value(item) for item in items]}
        if isinstance(term, Literal):
            return self._literal(term)
        properties = self.outline.properties.get(term) if self.outline.is_nested(term) else None
        return self._properties(properties) if properties else {"@id": self._identifier(term)}

    def _identifier(self, node: Subject) -> str:
        return f"_:{self.outline.label(node)}" if isinstance(node, BlankNode) else self._iri(node)

    def _iri(self, node: NamedNode) -> str:
        return self.names.prefixed(node.value) or node.value

    def _literal(self, literal: Literal) -> Any:
        if literal.language is not None:
            return {"@value": literal.value, "@language": literal.language}
        native = _native(literal.value, literal.datatype.value)
        if native is not None:
            return native
        return {"@value": literal.value, "@type": self._iri(literal.datatype)}


def _single(values: list[Any]) -> Any:
    return values[0] if len(values) == 1 else values


def _native(lexical: str, datatype: str) -> str | int | float | bool | None:
    """Return the JSON value that converts to exactly this literal, or None."""
    if datatype == XSD + "string":
        return lexical
    if datatype == XSD + "boolean" and lexical in ("true", "false"):
        return lexical == "true"
    if datatype == XSD + "integer" and _INTEGER.fullmatch(lexical):
        return int(lexical)
    if datatype == XSD + "double" and _DOUBLE.fullmatch(lexical):
        return _native_double(lexical)
    return None


def _native_double(lexical: str) -> float | None:
    """Return a fraction whose canonical form (JSON-LD API, 8.6) is ``lexical``; whole numbers would become integers."""
    number = float(lexical)
    if not math.isfinite(number) or number.is_integer():
        return None
    mantissa, _, exponent = f"{number!r}".partition("e") if "e" in repr(number) else f"{number:.15E}".partition("E")
    mantissa = mantissa.rstrip("0") if "." in mantissa else mantissa + ".0"
    mantissa = mantissa + "0" if mantissa.endswith(".") else mantissa
    same = f"{mantissa}E{int(exponent)}" == lexical and float(f"{mantissa}E{exponent}") == number
    return number if same else None
