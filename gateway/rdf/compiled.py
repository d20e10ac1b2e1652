"""SHACL shapes as Python: what pySHACL finds in a body in milliseconds, found in microseconds.

``compile_shape`` knows the constraints of SHACL Core that the shapes here use and agrees with pySHACL on them
(tests/gateway/rdf/test_compiled.py has the exceptions, each with its reason); at anything else it raises Unsupported,
never passes over it. Shapes are trusted: they come from this gateway, and their patterns and paths cost what they cost.
"""

from collections.abc import Mapping, Sequence

from pyoxigraph import BlankNode, Literal, NamedNode, Triple

from gateway.rdf.compiled_check import Guard, Shape
from gateway.rdf.compiled_constraints import COUNTS, EACH, Stated, Unsupported, at_most_one, natural, one
from gateway.rdf.compiled_data import (
    Data,
    Reach,
    alternative_path,
    inverse_path,
    optional_path,
    predicate_path,
    repeated_path,
    sequence_path,
)
from gateway.rdf.compiled_report import SHACL, Violation, brief, report, shown
from gateway.rdf.graph import Node, Term
from gateway.rdf.vocabulary import RDF, XSD

__all__ = ["Data", "Guard", "Unsupported", "Violation", "compile_shape", "report"]

_KNOWN = frozenset(
    (*COUNTS, *EACH, SHACL.property, SHACL.path, SHACL.flags, SHACL.name, SHACL.description, SHACL.order, SHACL.group,
     SHACL.defaultValue, SHACL.message, SHACL.severity, SHACL.deactivated, SHACL.targetClass, SHACL.targetNode,
     SHACL.targetSubjectsOf, SHACL.targetObjectsOf)
)  # fmt: skip
_WITH_QUALIFIED = (SHACL.qualifiedMinCount, SHACL.qualifiedMaxCount, SHACL.qualifiedValueShapesDisjoint)
_FALSE = Literal("false", datatype=XSD.boolean)


def compile_shape(triples: Sequence[Triple] | Mapping[Node, Sequence[Triple]], shape: Node) -> Guard:
    """The guard of ``shape`` in a shapes graph; Unsupported names what it cannot do. Targets are not looked at."""
    by_subject = triples if isinstance(triples, Mapping) else _by_subject(triples)
    if any(t.predicate == SHACL.parameter for about in by_subject.values() for t in about):
        raise Unsupported("constraint components of one's own")
    return Guard(_Compiler(by_subject).shape(shape, 0), by_subject)


def _by_subject(triples: Sequence[Triple]) -> dict[Node, list[Triple]]:
    found: dict[Node, list[Triple]] = {}
    for triple in triples:
        found.setdefault(triple.subject, []).append(triple)  # type: ignore[arg-type]
    return found


class _Compiler:
    def __init__(self, triples: Mapping[Node, Sequence[Triple]]) -> None:
        self._triples = triples
        self._open: set[Node] = set()
        self._done: dict[tuple[Node, int], Shape] = {}

    def shape(self, node: Term, depth: int) -> Shape:
        """``node`` as a shape whose focus nodes are ``depth`` paths away from that of the guard (2: or more)."""
        if isinstance(node, Literal) or node not in self._triples:
            raise Unsupported(f"{shown(node)} is not described as a shape")
        if node in self._open:
            raise Unsupported(f"{shown(node)} refers to itself")
        if (node, depth) not in self._done:
            self._open.add(node)
            self._done[node, depth] = self._compile(node, depth)
            self._open.discard(node)
        return self._done[node, depth]

    def _compile(self, node: Node, depth: int) -> Shape:
        stated = self._stated(node)
        _refuse_unknown(stated)
        path = at_most_one(stated, SHACL.path)
        if isinstance(path, Literal):
            raise Unsupported("a literal as path")
        name = _text(stated, SHACL.name) or (shown(path) if isinstance(path, NamedNode) else "")
        inner = depth if path is None else min(depth + 1, 2)
        shape = Shape(
            node, path, self._reach(path), name, _text(stated, SHACL.message), path is not None and depth >= 2,
            counts=tuple(c for p in stated if p in COUNTS for c in COUNTS[p](self, stated, inner)),
            each=tuple(c for p in stated if p in EACH for c in EACH[p](self, stated, inner)),
            properties=tuple(self._property(each, inner) for each in stated.get(SHACL.property, ())),
        )  # fmt: skip
        shape.requires = self._requires(shape, stated)
        shape.expected = _expected(shape)
        return shape

    def _property(self, node: Term, depth: int) -> Shape:
        shape = self.shape(node, depth)
        if shape.path is None:
            raise Unsupported(f"sh:property {shown(node)} without sh:path")
        return shape

    def _requires(self, shape: Shape, stated: Stated) -> dict[NamedNode, frozenset[Term]]:
        if shape.path is None:
            return {p: terms for each in shape.properties for p, terms in each.requires.items()}
        if not isinstance(shape.path, NamedNode):
            return {}
        if SHACL.hasValue in stated:
            return {shape.path: frozenset(stated[SHACL.hasValue][:1])}
        if SHACL.in_ in stated and SHACL.minCount in stated and natural(stated, SHACL.minCount) > 0:
            return {shape.path: frozenset(self.items(stated[SHACL.in_][0]))}
        return {}

    def _stated(self, node: Term) -> dict[NamedNode, list[Term]]:
        found: dict[NamedNode, list[Term]] = {}
        for triple in dict.fromkeys(self._triples.get(node, ())):  # type: ignore[arg-type]
            found.setdefault(triple.predicate, []).append(triple.object)  # type: ignore[arg-type]
        return found

    def items(self, head: Term) -> list[Term]:
        """The members of an RDF collection."""
        found: list[Term] = []
        seen = set()
        while head != RDF.nil:
            if head in seen:
                raise Unsupported("a collection without an end")
            seen.add(head)
            cell = self._stated(head)
            found.append(one(cell, RDF.first))
            head = one(cell, RDF.rest)
        return found

    def _reach(self, path: Term | None) -> Reach:
        if path is None:
            return lambda _, focus: (focus,)
        if isinstance(path, NamedNode):
            return predicate_path(path)
        if not isinstance(path, BlankNode) or path in self._open:
            raise Unsupported(f"{shown(path)} as path")
        self._open.add(path)
        reach = self._complex_path(self._stated(path), path)
        self._open.discard(path)
        return reach

    def _complex_path(self, stated: Stated, path: BlankNode) -> Reach:
        if RDF.first in stated:
            return sequence_path(self._ways(path))
        if len(stated) != 1:
            raise Unsupported("a path that is none")
        (kind,) = stated
        inner = one(stated, kind)
        if kind == SHACL.alternativePath:
            return alternative_path(self._ways(inner))
        # Of an inverse sequence pySHACL turns the steps but not their order, so nobody should rely on one.
        if kind == SHACL.inversePath and isinstance(inner, NamedNode):
            return inverse_path(inner)
        if kind == SHACL.zeroOrOnePath:
            return optional_path(self._reach(inner))
        if kind in (SHACL.zeroOrMorePath, SHACL.oneOrMorePath):
            return repeated_path(self._reach(inner), with_focus=kind == SHACL.zeroOrMorePath)
        raise Unsupported(f"{shown(kind)} of {shown(inner)}")

    def _ways(self, head: Term) -> list[Reach]:
        ways = [self._reach(each) for each in self.items(head)]
        if len(ways) < 2:
            raise Unsupported("a path of fewer than two parts")
        return ways


def _refuse_unknown(stated: Stated) -> None:
    known = _KNOWN.union(_WITH_QUALIFIED) if SHACL.qualifiedValueShape in stated else _KNOWN
    for predicate in stated:
        if predicate.value.startswith(SHACL.iri) and predicate not in known:
            raise Unsupported(shown(predicate))
    if at_most_one(stated, SHACL.severity) not in (None, SHACL.Violation):
        raise Unsupported("a severity other than sh:Violation")
    for predicate in (SHACL.deactivated, SHACL.qualifiedValueShapesDisjoint):
        if at_most_one(stated, predicate) not in (None, _FALSE):
            raise Unsupported(shown(predicate))


def _text(stated: Stated, predicate: NamedNode) -> str | None:
    texts = [term.value for term in stated.get(predicate, ()) if isinstance(term, Literal)]
    return texts[0] if texts else None


def _expected(shape: Shape) -> str:
    """What conforms, as part of a sentence: ``value at least 3 and at most 5``."""
    own = [count.expected for count in shape.counts] + [constraint.expected for constraint in shape.each]
    own = [f"{shape.name} {' and '.join(own)}"] if own and shape.name else own
    return brief(" and ".join([*own, *(each.expected for each in shape.properties)]))
