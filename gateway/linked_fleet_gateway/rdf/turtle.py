"""A Turtle writer. The same triples in the same order give the same bytes, nested as a person would write them.

RDF 1.1 Turtle, sections 2.4 (relative IRIs), 2.5 (literals), 2.7 (nesting), 2.8 (lists), 6.5 (grammar).
"""

import re
from collections.abc import Mapping, Sequence

from pyoxigraph import BlankNode, Literal, NamedNode, Triple

from linked_fleet_gateway.rdf import vocabulary as vocab
from linked_fleet_gateway.rdf.turtle_layout import TYPE, Outline, Properties, Subject, Term

XSD = vocab.XSD.iri
# Narrower than PN_LOCAL: IRIs with escapes, ':' or non-ASCII letters are written in full.
_LOCAL_NAME = re.compile(r"(?:[A-Za-z0-9_](?:[A-Za-z0-9_.-]*[A-Za-z0-9_-])?)?")
_BARE = {
    XSD + "integer": re.compile(r"[+-]?[0-9]+"),
    XSD + "decimal": re.compile(r"[+-]?[0-9]*\.[0-9]+"),
    XSD + "double": re.compile(r"[+-]?(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)[eE][+-]?[0-9]+"),
    XSD + "boolean": re.compile(r"true|false"),
}
_STRING = XSD + "string"
_ESCAPES = {code: f"\\u{code:04X}" for code in (*range(0x20), 0x7F)}
_ESCAPES |= {ord(k): v for k, v in {'"': '\\"', "\\": "\\\\", "\n": "\\n", "\r": "\\r", "\t": "\\t"}.items()}
_IRI_ESCAPES = {code: f"\\u{code:04X}" for code in (*range(0x21), *map(ord, '<>"{}|^`\\'))}
_HIERARCHICAL = re.compile(r"(https?://[^/?#]+)(/[^?#]*)?", re.IGNORECASE)
# RFC 3986, 4.2 and 5.2.4: no scheme, network path or dot segment, so that resolution is concatenation.
_PLAIN_PATH = re.compile(
    r"(?!\.{1,2}(?:[/?#]|$))[\w.~%!$&'()*+,;=@-]+(?:/(?!\.{1,2}(?:[/?#]|$))[\w.~%!$&'()*+,;=:@-]*)*", re.A
)
_TAIL = re.compile(r"(?:\?[\w.~%!$&'()*+,;=:@/?-]*)?(?:#[\w.~%!$&'()*+,;=:@/?-]*)?", re.ASCII)


class Names:
    """Shortens IRIs and records the prefixes used, and if the base was."""

    def __init__(self, prefixes: Mapping[str, str], base: str = "") -> None:
        self.used: dict[str, str] = {}
        self._prefix_of = {namespace: prefix for prefix, namespace in prefixes.items()}
        self.base, self._folder = _split(base)
        self.base_used = False

    def prefixed(self, iri: str) -> str | None:
        cut = max(iri.rfind("#"), iri.rfind("/")) + 1
        prefix = self._prefix_of.get(iri[:cut])
        if prefix is None or not _LOCAL_NAME.fullmatch(iri, cut):
            return None
        self.used[prefix] = iri[:cut]
        return f"{prefix}:{iri[cut:]}"

    def relative(self, iri: str) -> str | None:
        """Return a reference that resolves to exactly this IRI (RFC 3986, 5.2), in the simple cases only."""
        reference = _relative(iri, self.base, self._folder) if self._folder else None
        self.base_used = self.base_used or reference is not None
        return reference


def _split(base: str) -> tuple[str, str]:
    """Return the base, with at least a root path, and its folder for relative references; empty if unusable."""
    match = _HIERARCHICAL.fullmatch(base)
    if match is None or "/." in base or base.translate(_IRI_ESCAPES) != base:
        return "", ""
    base = base if match[2] else base + "/"
    return base, base[: base.rfind("/") + 1]


def _relative(iri: str, base: str, folder: str) -> str | None:
    # A bare query is a valid reference too, but rdflib resolves it below the folder.
    if iri.startswith(base) and not iri.startswith("?", len(base)) and _TAIL.fullmatch(iri, len(base)):
        return iri[len(base) :]
    if not iri.startswith(folder):
        return None
    if len(iri) == len(folder):
        return "./"
    path = _PLAIN_PATH.match(iri, len(folder))
    return iri[len(folder) :] if path and _TAIL.fullmatch(iri, path.end()) else None


def write(triples: Sequence[Triple], prefixes: Mapping[str, str], base: str) -> str:
    """Return the document with exactly the ``@prefix`` and ``@base`` lines that it needs."""
    writer = _Writer(Outline(triples), Names(prefixes, base))
    blocks = [writer.block(subject) for subject in writer.outline.headings]
    head = [f"@base <{writer.names.base}> .\n"] if writer.names.base_used else []
    head += [f"@prefix {prefix}: <{namespace}> .\n" for prefix, namespace in sorted(writer.names.used.items())]
    return "\n".join(["".join(head), *blocks] if head else blocks)


class _Writer:
    def __init__(self, outline: Outline, names: Names) -> None:
        self.outline = outline
        self.names = names
        self._written: dict[NamedNode, str] = {}

    def block(self, subject: Subject) -> str:
        name = "[]" if self.outline.is_anonymous(subject) else self.term(subject, "")
        return f"{name} {self._predicates(self.outline.properties[subject], '    ')} .\n"

    def _predicates(self, properties: Properties, indent: str) -> str:
        """Write one predicate per line, rdf:type first."""
        types = {TYPE: properties[TYPE]} if TYPE in properties else {}
        lines = [
            f"{'a' if predicate == TYPE else self.iri(predicate)} {', '.join(self.term(v, indent) for v in values)}"
            for predicate, values in (types | properties).items()
        ]
        return f" ;\n{indent}".join(lines)

    def term(self, term: Term, indent: str) -> str:
        items = self.outline.list_items(term)
        if items is not None:
            return f"( {' '.join(self.term(item, indent) for item in items)} )" if items else "()"
        if isinstance(term, NamedNode):
            return self.iri(term)
        if isinstance(term, Literal):
            return self._literal(term)
        return self._nested(term, indent + "    ") if self.outline.is_nested(term) else f"_:{self.outline.label(term)}"

    def _nested(self, node: BlankNode, indent: str) -> str:
        properties = self.outline.properties.get(node)
        return f"[\n{indent}{self._predicates(properties, indent)}\n{indent[4:]}]" if properties else "[]"

    def iri(self, node: NamedNode) -> str:
        written = self._written.get(node)
        if written is None:
            written = self._written[node] = self._shorten(node.value)
        return written

    def _shorten(self, iri: str) -> str:
        prefixed = self.names.prefixed(iri)
        if prefixed is not None:
            return prefixed
        relative = self.names.relative(iri)
        return f"<{iri.translate(_IRI_ESCAPES) if relative is None else relative}>"

    def _literal(self, literal: Literal) -> str:
        datatype = literal.datatype.value
        bare = _BARE.get(datatype)
        if bare is not None and bare.fullmatch(literal.value):
            return literal.value
        quoted = f'"{literal.value.translate(_ESCAPES)}"'
        if literal.language is not None:
            return f"{quoted}@{literal.language}"
        return quoted if datatype == _STRING else f"{quoted}^^{self.iri(literal.datatype)}"
