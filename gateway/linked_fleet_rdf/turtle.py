"""A Turtle writer, and the layout that it shares with JSON-LD.

All walks are iterative, so that no graph, however deep or cyclic, overflows the stack.

RDF 1.1 Turtle, sections 2.4 (relative IRIs), 2.5 (literals), 2.7 (nesting), 2.8 (lists), 6.5 (grammar).
"""

import re
from collections.abc import Mapping, Sequence

from pyoxigraph import BlankNode, Literal, NamedNode, Triple

_RDF = "http://www.w3.org/1999/02/22-rdf-syntax-ns#"
TYPE, FIRST, REST, NIL = (NamedNode(_RDF + name) for name in ("type", "first", "rest", "nil"))
MAX_NESTING = 32

Subject = NamedNode | BlankNode
Term = NamedNode | BlankNode | Literal
Properties = dict[NamedNode, list[Term]]


class Outline:
    """Subjects in order of appearance. Blank nodes with exactly one reference are nested at that reference."""

    def __init__(self, triples: Sequence[Triple]) -> None:
        self.properties: dict[Subject, Properties] = {}
        self.references: dict[BlankNode, list[tuple[Subject, NamedNode]]] = {}
        self._labels: dict[BlankNode, str] = {}
        for triple in dict.fromkeys(triples):
            self._add(triple)
        self._cells = self._list_cells()
        self._nested: set[BlankNode] = set()
        self.headings = self._arrange()

    def _add(self, triple: Triple) -> None:
        subject, predicate, value = triple.subject, triple.predicate, triple.object
        if isinstance(subject, Triple) or isinstance(value, Triple):
            raise TypeError("triple terms (RDF 1.2) have no place in our documents")
        self.properties.setdefault(subject, {}).setdefault(predicate, []).append(value)
        if isinstance(value, BlankNode):
            self.references.setdefault(value, []).append((subject, predicate))

    def label(self, node: BlankNode) -> str:
        """Return ``b0``, ``b1``, … in order of first use in the document."""
        return self._labels.setdefault(node, f"b{len(self._labels)}")

    def is_nested(self, node: Term) -> bool:
        return isinstance(node, BlankNode) and node in self._nested

    def is_anonymous(self, node: Subject) -> bool:
        """Return True if nothing refers to the node, so that it needs no label."""
        return isinstance(node, BlankNode) and node not in self.references

    def list_items(self, node: Term) -> list[Term] | None:
        """Return the items if the node is rdf:nil or the head of a well-formed nested list, else None."""
        if not (node == NIL or (self.is_nested(node) and node in self._cells)):
            return None
        items = []
        while isinstance(node, BlankNode):
            cell = self.properties[node]
            items.append(cell[FIRST][0])
            node = cell[REST][0]
        return items

    def _list_cells(self) -> set[Subject]:
        """Return cells from which rdf:rest leads to rdf:nil over cells with one reference and no other statements."""
        cells: set[Subject] = set()
        for subject, properties in self.properties.items():
            if properties.get(REST) != [NIL]:
                continue
            cell: Subject | None = subject
            while cell is not None and self._is_cell(cell):
                cells.add(cell)
                owner, predicate = self.references[cell][0]  # type: ignore[index]  # _is_cell: a blank node
                cell = owner if predicate == REST else None
        return cells

    def _is_cell(self, node: Subject) -> bool:
        properties = self.properties[node]
        return (
            isinstance(node, BlankNode)
            and len(self.references.get(node, ())) == 1
            and len(properties) == 2
            and len(properties.get(FIRST, ())) == 1
            and len(properties.get(REST, ())) == 1
        )

    def _arrange(self) -> list[Subject]:
        """Select nested nodes and return the top-level subjects.

        Cycles are cut at their first subject, depth at MAX_NESTING.
        """
        headings: dict[Subject, None] = {}
        for subject in self.properties:
            if not (isinstance(subject, BlankNode) and len(self.references.get(subject, ())) == 1):
                self._nest_below(subject, headings)
        for subject in self.properties:
            if subject not in headings and subject not in self._nested:
                self._nest_below(subject, headings)
        return [subject for subject in self.properties if subject in headings]

    def _nest_below(self, heading: Subject, headings: dict[Subject, None]) -> None:
        headings[heading] = None
        pending: list[tuple[Subject, int]] = [(heading, 0)]
        while pending:
            owner, depth = pending.pop()
            for predicate, values in self.properties.get(owner, {}).items():
                along_list = predicate == REST and owner in self._cells
                for value in values:
                    if not isinstance(value, BlankNode) or len(self.references[value]) > 1 or value in headings:
                        continue
                    below = depth if along_list else depth + 1
                    if below > MAX_NESTING:
                        headings[value] = None
                        below = 0
                    else:
                        self._nested.add(value)
                    pending.append((value, below))


XSD = "http://www.w3.org/2001/XMLSchema#"
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


def write_turtle(triples: Sequence[Triple], prefixes: Mapping[str, str], base: str) -> str:
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
