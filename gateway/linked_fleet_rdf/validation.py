"""Bodies from clients, judged: by a published shape, and as far as no shape judges them.

A write refuses triples that its reader does not use, because it would lose them (LDP 4.2.4.4).
"""

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Self

from pyoxigraph import BlankNode, Literal, NamedNode, Triple

from linked_fleet_base.errors import UnprocessableContent
from linked_fleet_rdf.graph import UNITS, Graph, Node, Term
from linked_fleet_rdf.vocabulary import LDP, NUMERIC, PREFIXES, QUDT, RDF, SH, VOM, XSD
from linked_fleet_shacl import Data, Statement, Violation, compile_shape, report

# The lexical spaces of XML Schema 2, 3.2 and 3.3 (RDF 1.1 Concepts, 5.1), without white space, which only XML
# collapses. Python's float accepts more, such as 1_0.
_INTEGER = re.compile(r"[+-]?[0-9]+")
_DECIMAL = re.compile(r"[+-]?(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)")
_FLOAT = re.compile(r"[+-]?(?:[0-9]+(?:\.[0-9]*)?|\.[0-9]+)(?:[eE][+-]?[0-9]+)?")
_LEXICAL = {XSD.decimal: _DECIMAL, XSD.float: _FLOAT, XSD.double: _FLOAT}
_XML_NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_.-]*\Z")


def find_root(body: Sequence[Triple], target: NamedNode, *, creates_member: bool = False) -> Node:
    """Return ``<>``, else the only subject that is not an object: a blank node.

    ``creates_member``: the body describes a new member of the container ``target``. Raises UnprocessableContent for no
    such root, or for one that is another resource.
    """
    subjects = dict.fromkeys(t.subject for t in body)
    if target in subjects:
        return target
    objects = {t.object for t in body}
    roots = [s for s in subjects if s not in objects]
    if len(roots) != 1:
        found = "no triples" if not body else f"{len(roots)} subjects that nobody refers to"
        raise UnprocessableContent(
            f"The body has {found}; it needs one root: <> (the request URI), or the only subject "
            "that is nobody's object.",
            constraint=target.value,
        )
    return check_root(roots[0], target, creates_member=creates_member)  # type: ignore[arg-type]


def check_root(root: Node, target: NamedNode, *, creates_member: bool = False) -> Node:
    """Return the root of a body for ``target``. Raises UnprocessableContent if it is another resource.

    A description of a member can be sent to its container, to create another one.
    """
    is_member = creates_member and root.value.startswith(target.value.rstrip("/") + "/")
    if isinstance(root, BlankNode) or root == target or is_member:
        return root
    raise UnprocessableContent(
        f"The body is about <{root.value[:_LONGEST_IRI]}>, but it was sent to <{target.value}>. "
        "Its subject is <> (the request URI) or a blank node. Nothing has changed.",
        constraint=target.value,
    )


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


_MOST_TOLD = 5  # the report contains all of them


class ShaclValidator:
    """Validates with ``shape`` among ``triples``. Raises Unsupported, with the reason, if it cannot be compiled.

    ``prefixes`` shorten IRIs in messages.
    """

    def __init__(
        self, triples: Iterable[Triple | Statement], shape: Node, prefixes: Mapping[str, str] = PREFIXES
    ) -> None:
        self._shape = compile_shape(triples, shape, prefixes)

    def report(self, body: Sequence[Triple], focus: Node) -> tuple[str, list[Statement]] | None:
        """Return None if the body conforms, else a sentence about the violations and the validation report (SHACL,
        3.6).
        """
        violations = self._shape.check(Data(body), focus)
        if not violations:
            return None
        messages = list(dict.fromkeys(each.message for each in _direct(violations)))
        return _sentence(messages), report(violations, self._shape.triples)


def _direct(violations: Sequence[Violation]) -> list[Violation]:
    """Drop violations that others explain: with two units, or an unknown one, no branch of an ``sh:or`` holds."""
    said = {(each.focus, each.path) for each in violations if not each.detail}
    return [each for each in violations if not any((inner.focus, inner.path) in said for inner in each.detail)]


def _sentence(messages: Sequence[str]) -> str:
    more = [f"and {len(messages) - _MOST_TOLD} more"] if len(messages) > _MOST_TOLD else []
    return "; ".join([*messages[:_MOST_TOLD], *more])


COMMON_TYPES = frozenset({LDP.Resource, LDP.RDFSource})
_MOST_NAMED, _MOST_IN_DETAIL = 20, 3
_LONGEST_IRI, _LONGEST_LITERAL = 200, 32


@dataclass
class Terms:
    """The predicates and types allowed at a node and, by predicate, those allowed at the nodes it leads to."""

    inner: dict[NamedNode, "Terms"] = field(default_factory=dict)
    types: set[Term] = field(default_factory=set)

    @property
    def allows_any(self) -> bool:
        """Return True if any predicate or type is allowed at such a node."""
        return bool(self.inner or self.types)

    @classmethod
    def from_shapes(cls, shapes: Mapping[Node, Sequence[Triple]], *roots: Node) -> Self:
        """Return all terms of the shapes ``roots``, among ``shapes``, which are not recursive."""
        found = cls()
        for each in roots:
            _Reader(shapes).add(found, each)
        return found

    def with_terms(self, *predicates: NamedNode, types: Iterable[Term] = ()) -> Self:
        """Return these terms with additional predicates and types at the first node."""
        return type(self)(self.inner | {each: Terms() for each in predicates}, self.types.union(types))


class _Reader:
    """Collects terms from the triples of shapes."""

    def __init__(self, shapes: Mapping[Node, Sequence[Triple]]) -> None:
        self._shapes = shapes

    def add(self, terms: Terms, shape: Node) -> None:
        for predicate, value in self._stated(shape):
            if predicate == SH.property:
                self._property(terms, value)
            elif predicate == SH.node:
                self.add(terms, value)
            elif predicate in (SH.or_, SH.and_):
                for each in self._items(value):
                    self.add(terms, each)
            elif predicate in (SH.targetClass, SH.class_):
                terms.types.add(value)

    def _property(self, terms: Terms, shape: Node) -> None:
        for path in self._paths(shape):
            if path == RDF.type:
                terms.types.update(self._values(shape))
            else:
                self.add(terms.inner.setdefault(path, Terms()), shape)

    def _paths(self, shape: Node) -> list[NamedNode]:
        """Return the predicate of the path, or each of its alternatives."""
        paths = [value for predicate, value in self._stated(shape) if predicate == SH.path]
        ways = [value for path in paths for predicate, value in self._stated(path) if predicate == SH.alternativePath]
        found = [*paths, *(each for way in ways for each in self._items(way))]
        return [each for each in found if isinstance(each, NamedNode)]

    def _values(self, shape: Node) -> list[Node]:
        stated = self._stated(shape)
        listed = [each for predicate, value in stated if predicate == SH.in_ for each in self._items(value)]
        return [*listed, *(value for predicate, value in stated if predicate == SH.hasValue)]

    def _items(self, cell: Node) -> list[Node]:
        found: list[Node] = []
        while cell != RDF.nil:
            stated = dict(self._stated(cell))
            found.append(stated[RDF.first])
            cell = stated[RDF.rest]
        return found

    def _stated(self, node: Node) -> list[tuple[NamedNode, Node]]:
        return [
            (triple.predicate, triple.object)
            for triple in self._shapes.get(node, ())
            if isinstance(triple.object, NamedNode | BlankNode)
        ]


def unused_statements(
    body: Sequence[Triple], focus: Node, terms: Terms, current: frozenset[Triple] = frozenset()
) -> list[Triple]:
    """Return the triples that are neither about ``focus`` in these terms nor in ``current``."""
    by_subject = statements_by_subject(body)
    used: set[int] = set()  # by identity, because hashing a triple takes longer than the rest of the loop
    pending, done = [(focus, terms)], set[tuple[Node, int]]()
    while pending:
        node, known = pending.pop()
        if (node, id(known)) in done:
            continue
        done.add((node, id(known)))
        about = by_subject.get(node, ())
        for triple in about:
            _, predicate, value = triple
            inner = known.inner.get(predicate)
            if inner is not None:
                used.add(id(triple))
                if inner.allows_any and not isinstance(value, Literal):
                    pending.append((value, inner))
            elif _is_implied(predicate, value, known, about, node == focus):
                used.add(id(triple))
    left = [triple for triple in body if id(triple) not in used]
    return [triple for triple in dict.fromkeys(left) if triple not in current]


def _is_implied(predicate: object, value: object, known: Terms, about: Sequence[Triple], first: bool) -> bool:
    """Return True for a type that the node has anyway, or a QUDT unit equal to the stated one."""
    if predicate == RDF.type:
        return value in known.types or (first and value in COMMON_TYPES)
    if predicate != QUDT.unit or VOM.unit not in known.inner or value not in UNITS:
        return False
    units = [UNITS.get(t.object) for t in about if t.predicate == VOM.unit]  # type: ignore[arg-type]
    return UNITS[value] in units  # type: ignore[index]


def statements_by_subject(triples: Iterable[Triple]) -> dict[Node, list[Triple]]:
    """Return the triples by subject."""
    found: dict[Node, list[Triple]] = {}
    for triple in triples:
        found.setdefault(triple.subject, []).append(triple)  # type: ignore[arg-type]
    return found


def reachable_statements(body: Iterable[Triple], *foci: Node) -> list[Triple]:
    """Return the triples about ``foci`` and about the nodes that these refer to."""
    by_subject, found = statements_by_subject(body), list[Triple]()
    pending = list(foci)
    while pending:
        for triple in by_subject.pop(pending.pop(), ()):
            found.append(triple)
            if isinstance(triple.object, NamedNode | BlankNode):
                pending.append(triple.object)
    return found


def ground_statements(description: Graph) -> frozenset[Triple]:
    """Return the triples of a description that a client can send back unchanged: those without blank nodes."""
    return frozenset(t for t in description.triples if not any(isinstance(term, BlankNode) for term in t))


def refuse_statements(statements: Sequence[Triple], constraint: str, reason: str = "Nothing here uses") -> None:
    """Raise UnprocessableContent that names the triples ``statements`` of a body, unless there are none."""
    if not statements:
        return
    named = [f"{_term(t.subject)} {_term(t.predicate)} {_term(t.object)} ." for t in statements[:_MOST_NAMED]]
    more = f" and {len(statements) - _MOST_IN_DETAIL} more" if len(statements) > _MOST_IN_DETAIL else ""
    detail = f"{reason} what the body says by {' '.join(named[:_MOST_IN_DETAIL])}{more}"
    raise UnprocessableContent(f"{detail} Leave it out. Nothing has changed.", constraint=constraint, unused=named)


def _term(term: object) -> str:
    """Return a term as in N-Triples, shortened. Long literals are cut because they may be secrets."""
    if isinstance(term, Literal):
        text = term.value if len(term.value) <= _LONGEST_LITERAL else term.value[: _LONGEST_LITERAL // 4] + "…"
        return str(Literal(text))
    return str(term) if len(str(term)) <= _LONGEST_IRI else str(term)[:_LONGEST_IRI] + "…>"
