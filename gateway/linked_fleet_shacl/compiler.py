"""Compilation of a shapes graph. Shapes are trusted: the cost of their patterns and paths is not bounded."""

from collections.abc import Callable, Iterable, Mapping, Set

from pyoxigraph import BlankNode, Literal, NamedNode, Triple

from linked_fleet_shacl.check import CompiledGraph, CompiledShape, Constraint, Count, Relation, Shape
from linked_fleet_shacl.constraints import COUNTS, EACH
from linked_fleet_shacl.data import (
    Reach,
    alternative_path,
    inverse_path,
    optional_path,
    predicate_path,
    repeated_path,
    sequence_path,
)
from linked_fleet_shacl.relations import RELATIONS
from linked_fleet_shacl.report import AnyTriple, Statements, TermTexts, term_text
from linked_fleet_shacl.statements import (
    TARGETS,
    Shapes,
    Unsupported,
    at_most_one,
    boolean,
    exactly_one,
    natural_number,
    targets,
)
from linked_fleet_shacl.terms import PREFIXES, RDF, SHACL, Node, Term

_KNOWN = frozenset(
    (*COUNTS, *RELATIONS, *EACH, *TARGETS, SHACL.property, SHACL.path, SHACL.flags, SHACL.ignoredProperties, SHACL.name,
     SHACL.description, SHACL.order, SHACL.group, SHACL.defaultValue, SHACL.message, SHACL.severity, SHACL.deactivated)
)  # fmt: skip
_READERS: Mapping[NamedNode, Callable[[Shapes, Statements, int], Iterable[Count | Relation | Constraint]]] = {
    **COUNTS, **RELATIONS, **EACH,
}  # fmt: skip
_WITH_QUALIFIED = (SHACL.qualifiedMinCount, SHACL.qualifiedMaxCount, SHACL.qualifiedValueShapesDisjoint)
_OF_GRAPHS = {SHACL.parameter: "constraint components of one's own", SHACL.entailment: "sh:entailment"}


def compile_shape(triples: Iterable[AnyTriple], shape: Node, prefixes: Mapping[str, str] = PREFIXES) -> CompiledShape:
    """Compile ``shape`` of a shapes graph for any focus node, ignoring targets; ``prefixes`` shorten IRIs in messages.

    Raises Unsupported, which names the construct.
    """
    return Compiler(triples, prefixes).compile(shape)


def compile_graph(triples: Iterable[AnyTriple], prefixes: Mapping[str, str] = PREFIXES) -> CompiledGraph:
    """Compile all shapes of a graph that have targets. Raises Unsupported, which names the construct."""
    stated = [Triple(*triple) for triple in triples]
    compiler = Compiler(stated, prefixes)
    return CompiledGraph([(compiler.compile(shape), find) for shape, find in targets(stated)])


def _by_subject(triples: Iterable[AnyTriple]) -> dict[Node, dict[NamedNode, list[Term]]]:
    """Return the values of each subject and predicate, each once."""
    found: dict[Node, dict[NamedNode, list[Term]]] = {}
    for subject, predicate, value in triples if isinstance(triples, Set) else dict.fromkeys(triples):
        about = found.get(subject)
        if about is None:
            found[subject] = {predicate: [value]}
        elif predicate in about:
            about[predicate].append(value)
        else:
            about[predicate] = [value]
    return found


class Compiler:
    """Compiles several shapes of one graph, which is searched once for what is unsupported. Raises Unsupported."""

    def __init__(self, triples: Iterable[AnyTriple], prefixes: Mapping[str, str] = PREFIXES) -> None:
        self._stated = _by_subject(triples)
        self.texts = TermTexts(prefixes)
        for about in self._stated.values():
            if not _OF_GRAPHS.keys().isdisjoint(about):
                raise Unsupported(next(text for predicate, text in _OF_GRAPHS.items() if predicate in about))
        self._open: set[Node] = set()
        self._done: dict[tuple[Term, int], Shape] = {}

    def compile(self, shape: Node) -> CompiledShape:
        """Compile a shape as ``compile_shape`` does. Raises Unsupported, after which nothing else may be compiled."""
        return CompiledShape(self.shape(shape, 0), self._stated, self.texts)

    def shape(self, node: Term, depth: int) -> Shape:
        """Return ``node`` as a shape whose focus nodes are ``depth`` paths away from the first one (2 means two or
        more).
        """
        if (done := self._done.get((node, depth))) is not None:
            return done
        if isinstance(node, Literal) or node not in self._stated:
            raise Unsupported(f"{term_text(node)} is not described as a shape")
        if node in self._open:
            raise Unsupported(f"{term_text(node)} refers to itself")
        self._open.add(node)
        shape = self._done[node, depth] = self._compile(node, depth)
        self._open.discard(node)
        return shape

    def _compile(self, node: Node, depth: int) -> Shape:
        stated = self._stated[node]
        _refuse_unknown(stated)
        path = at_most_one(stated, SHACL.path)
        if isinstance(path, Literal):
            raise Unsupported("a literal as path")
        name = _text(stated, SHACL.name) or (self.texts.text(path) if isinstance(path, NamedNode) else "")
        severity = at_most_one(stated, SHACL.severity) or SHACL.Violation
        if not isinstance(severity, NamedNode):
            raise Unsupported(f"sh:severity {term_text(severity)}")
        shape = Shape(
            node, path, self._reach(path), name, _text(stated, SHACL.message), path is not None and depth >= 2, severity
        )  # fmt: skip
        if SHACL.deactivated in stated and boolean(stated, SHACL.deactivated):
            return shape
        inner = depth if path is None else min(depth + 1, 2)
        counts: list[Count] = []  # list[Count]() takes many times as long
        relations: list[Relation] = []
        constraints: list[Constraint] = []
        for predicate in stated:
            if (read := _READERS.get(predicate)) is None:
                continue
            for each in read(self, stated, inner):
                if isinstance(each, Constraint):
                    constraints.append(each)
                elif isinstance(each, Count):
                    counts.append(each)
                else:
                    relations.append(each)
        shape.counts, shape.relations, shape.value_constraints = tuple(counts), tuple(relations), tuple(constraints)
        shape.properties = tuple([self._property(each, inner) for each in stated.get(SHACL.property, ())])
        return shape

    def _property(self, node: Term, depth: int) -> Shape:
        shape = self.shape(node, depth)
        if shape.path is None:
            raise Unsupported(f"sh:property {term_text(node)} without sh:path")
        return shape

    def requires(self, shape: Shape) -> Mapping[NamedNode, frozenset[Term]]:
        """Return predicates, each with terms of which a node that conforms has one."""
        stated = self._stated[shape.node]
        if shape.path is None:
            return {path: terms for each in shape.properties for path, terms in self.requires(each).items()}
        if not isinstance(shape.path, NamedNode) or not shape.counts:
            return {}
        if SHACL.hasValue in stated:
            return {shape.path: frozenset(stated[SHACL.hasValue][:1])}
        if SHACL.in_ in stated and SHACL.minCount in stated and natural_number(stated, SHACL.minCount) > 0:
            return {shape.path: frozenset(self.items(stated[SHACL.in_][0]))}
        return {}

    def statements(self, node: Term) -> Statements:
        return self._stated.get(node, {})  # type: ignore[arg-type]

    def paths(self, properties: Iterable[Term]) -> Iterable[NamedNode]:
        """Return the predicates of property shapes."""
        found = (self.statements(each).get(SHACL.path, ()) for each in properties)
        return (path for some in found for path in some if isinstance(path, NamedNode))

    def items(self, head: Term) -> list[Term]:
        """Return the members of an RDF collection."""
        found: list[Term] = []
        seen = set()
        while head != RDF.nil:
            if head in seen:
                raise Unsupported("a collection without an end")
            seen.add(head)
            cell = self.statements(head)
            found.append(exactly_one(cell, RDF.first))
            head = exactly_one(cell, RDF.rest)
        return found

    def _reach(self, path: Term | None) -> Reach:
        if path is None:
            return lambda _, focus: (focus,)
        if isinstance(path, NamedNode):
            return predicate_path(path)
        if not isinstance(path, BlankNode) or path in self._open:
            raise Unsupported(f"{term_text(path)} as path")
        self._open.add(path)
        reach = self._complex_path(self.statements(path), path)
        self._open.discard(path)
        return reach

    def _complex_path(self, stated: Statements, path: BlankNode) -> Reach:
        if RDF.first in stated:
            return sequence_path(self._ways(path))
        if len(stated) != 1:
            raise Unsupported("a path that is none")
        (kind,) = stated
        inner = exactly_one(stated, kind)
        if kind == SHACL.alternativePath:
            return alternative_path(self._ways(inner))
        # pySHACL inverts the steps of an inverse sequence but not their order, so such paths are refused.
        if kind == SHACL.inversePath and isinstance(inner, NamedNode):
            return inverse_path(inner)
        if kind == SHACL.zeroOrOnePath:
            return optional_path(self._reach(inner))
        if kind in (SHACL.zeroOrMorePath, SHACL.oneOrMorePath):
            return repeated_path(self._reach(inner), with_focus=kind == SHACL.zeroOrMorePath)
        raise Unsupported(f"{term_text(kind)} of {term_text(inner)}")

    def _ways(self, head: Term) -> list[Reach]:
        ways = [self._reach(each) for each in self.items(head)]
        if len(ways) < 2:
            raise Unsupported("a path of fewer than two parts")
        return ways


def _refuse_unknown(stated: Statements) -> None:
    known = _KNOWN.union(_WITH_QUALIFIED) if SHACL.qualifiedValueShape in stated else _KNOWN
    if not stated.keys() <= known:
        for predicate in stated:  # in their order, so that the reason is always the same
            if predicate not in known and predicate.value.startswith(SHACL.iri):
                raise Unsupported(term_text(predicate))
    if SHACL.qualifiedValueShapesDisjoint in stated and boolean(stated, SHACL.qualifiedValueShapesDisjoint):
        raise Unsupported("sh:qualifiedValueShapesDisjoint")


def _text(stated: Statements, predicate: NamedNode) -> str | None:
    for term in stated.get(predicate, ()):
        if isinstance(term, Literal):
            return term.value
    return None
