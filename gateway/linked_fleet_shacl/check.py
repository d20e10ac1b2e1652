"""Execution of a compiled shape: first a fast test of conformance, and only on failure the violations.

Both are bounded for any data: a node reached by many paths is checked once, and a report ends after MOST violations.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import islice

from pyoxigraph import NamedNode

from linked_fleet_shacl.data import Data, Reach
from linked_fleet_shacl.report import Statements, TermTexts, Violation, shortened
from linked_fleet_shacl.terms import SHACL, Node, Term

MOST = 25  # violations in a report; more would not help its reader
_MOST_DETAILS = 50

Values = Sequence[Term]
Expectation = Callable[[], str]
"""Returns a condition as part of a sentence. A text is needed for a refusal alone, and takes long to write."""
# A failed discriminator tells that a branch of sh:or was not the one that was meant.
_DISCRIMINATORS = (SHACL.HasValueConstraintComponent, SHACL.InConstraintComponent)


def _is_missed(violations: Sequence[Violation]) -> bool:
    """Return True for the violations of a branch of ``sh:or`` that was not meant."""
    return any(each.component in _DISCRIMINATORS for each in violations)


@dataclass
class Run:
    """The explanation of one refusal: its remaining number of details, and the explanations found so far."""

    texts: TermTexts
    remaining: int = _MOST_DETAILS
    explanations: dict[tuple[object, Term], tuple[Violation, ...]] = field(default_factory=dict)

    def detail(self, shape: "Shape", data: Data, value: Term) -> tuple[Violation, ...]:
        if self.remaining <= 0:
            return ()
        found = tuple(islice(shape.violations(data, value, self), self.remaining))
        self.remaining -= len(found)
        return found


@dataclass(eq=False, slots=True)
class Count:
    """A constraint on all value nodes of a shape together."""

    component: NamedNode
    expected: Expectation
    holds: Callable[[Data, Values], bool]


@dataclass(eq=False, slots=True)
class Relation:
    """A constraint on the relation of a focus node to its value nodes or to the surrounding data.

    ``faults`` yields the predicate and the value at fault; None stands for the path of the shape and for no value.
    """

    component: NamedNode
    expected: Expectation
    faults: Callable[[Data, Term, Values], Iterable[tuple[NamedNode | None, Term | None]]]

    def holds(self, data: Data, focus: Term, values: Values) -> bool:
        return next(iter(self.faults(data, focus, values)), None) is None


@dataclass(eq=False, slots=True)
class Constraint:
    """A constraint on each value node; violations of the ``inner`` shapes explain it."""

    component: NamedNode
    expected: Expectation
    holds: Callable[[Data, Term], bool]
    inner: tuple["Shape", ...] = ()

    def explain(self, data: Data, value: Term, run: Run) -> tuple[str, tuple[Violation, ...]]:
        """Return the violated condition as text, and the violations of the inner shapes."""
        detail = tuple(found for shape in self.inner for found in run.detail(shape, data, value))
        told = "; ".join(found.message for found in detail)
        return shortened(told or f"{run.texts.text(value)} must be {self.expected()}"), detail


@dataclass(eq=False, slots=True)
class Either(Constraint):
    """``sh:or``, explained by the intended branch if that can be determined."""

    def explain(self, data: Data, value: Term, run: Run) -> tuple[str, tuple[Violation, ...]]:
        found = [run.detail(shape, data, value) for shape in self.inner]
        meant = [each for each in found if each and not _is_missed(each)]
        if 0 < len(meant) < len(found):
            best = min(meant, key=len)
            return shortened("; ".join(v.message for v in best)), best
        return shortened(f"{run.texts.text(value)} must be {self.expected()}"), tuple(v for each in found for v in each)


@dataclass(eq=False, slots=True)
class Switch(Constraint):
    """``sh:or`` whose branches each require certain values of one predicate; only branches that apply are checked."""

    predicate: NamedNode = field(kw_only=True)
    table: Mapping[Term, tuple["Shape", ...]] = field(kw_only=True)

    def explain(self, data: Data, value: Term, run: Run) -> tuple[str, tuple[Violation, ...]]:
        meant = list(self.applicable(data, value))
        if not meant:
            return f"{run.texts.text(self.predicate)} must be one of {run.texts.list_text(self.table)}", ()
        found = [run.detail(shape, data, value) for shape in meant]
        fitting = [each for each in found if each and not _is_missed(each)]
        if any(found) and not fitting:  # such as a unit of none of the branches: what any of them permits
            missed = ("; ".join(v.message for v in each if v.component in _DISCRIMINATORS) for each in found)
            return shortened("; or ".join(filter(None, dict.fromkeys(missed)))), tuple(
                v for each in found for v in each
            )
        best = min(fitting, key=len, default=())
        return shortened(
            "; ".join(v.message for v in best) or f"{run.texts.text(value)} must be {self.expected()}"
        ), best

    def applicable(self, data: Data, value: Term) -> Iterator["Shape"]:
        for term in data.objects(value, self.predicate):
            yield from self.table.get(term, ())


@dataclass(eq=False, slots=True)
class Shape:
    """A node shape (``path`` is None, and ``reach`` yields the focus alone) or a property shape.

    ``caches_results`` is set if several paths may lead to the same focus.
    """

    node: Node
    path: Node | None
    reach: Reach
    name: str
    message: str | None
    caches_results: bool
    severity: NamedNode
    counts: tuple[Count, ...] = ()
    relations: tuple[Relation, ...] = ()
    value_constraints: tuple[Constraint, ...] = ()
    properties: tuple["Shape", ...] = ()
    _expected: str | None = None

    def expected(self) -> str:
        """Return the condition as part of a sentence: ``value at least 3 and at most 5``."""
        if self._expected is None:
            stated: list[Count | Relation | Constraint] = [*self.counts, *self.relations, *self.value_constraints]
            own = [each.expected() for each in stated]
            own = [f"{self.name} {' and '.join(own)}"] if own and self.name else own
            self._expected = shortened(" and ".join([*own, *(each.expected() for each in self.properties)]))
        return self._expected

    def conforms(self, data: Data, focus: Term) -> bool:
        if not self.caches_results:
            return self._judge(data, focus)
        verdict = data.verdicts.get((self, focus))
        if verdict is None:
            verdict = data.verdicts[self, focus] = self._judge(data, focus)
        return verdict

    def _judge(self, data: Data, focus: Term) -> bool:
        values = tuple(self.reach(data, focus))
        for count in self.counts:
            if not count.holds(data, values):
                return False
        for relation in self.relations:
            if not relation.holds(data, focus, values):
                return False
        for value in values:
            for constraint in self.value_constraints:
                if not constraint.holds(data, value):
                    return False
            for shape in self.properties:
                if not shape.conforms(data, value):
                    return False
        return True

    def violations(self, data: Data, focus: Term, run: Run) -> Iterable[Violation]:
        if not self.caches_results:
            return self._violations(data, focus, run)
        explanation = run.explanations.get((self, focus))
        if explanation is None:
            explanation = run.explanations[self, focus] = tuple(islice(self._violations(data, focus, run), MOST))
        return explanation

    def _violations(self, data: Data, focus: Term, run: Run) -> Iterator[Violation]:
        values = tuple(self.reach(data, focus))
        for count in self.counts:
            if not count.holds(data, values):
                told = f"must {count.expected()}, and has {run.texts.list_text(values) or 'none'}"
                yield self._violation(focus, None, count.component, told)
        for relation in self.relations:
            for path, value in relation.faults(data, focus, values):
                at_fault = " ".join(run.texts.text(each) for each in (path, value) if each is not None)
                told = f"must {relation.expected()}" + (f"; at fault: {at_fault}" if at_fault else "")
                yield self._violation(focus, value, relation.component, told, path=path)
        for value in values:
            for constraint in self.value_constraints:
                if not constraint.holds(data, value):
                    told, detail = constraint.explain(data, value, run)
                    yield self._violation(focus, value, constraint.component, told, detail)
            for shape in self.properties:
                yield from shape.violations(data, value, run)

    def _violation(
        self,
        focus: Term,
        value: Term | None,
        component: NamedNode,
        told: str,
        detail: tuple[Violation, ...] = (),
        path: Node | None = None,
    ) -> Violation:
        message = self.message or (f"{self.name}: {told}" if self.name else told)
        return Violation(focus, path or self.path, value, component, self.node, message, detail, self.severity)


@dataclass(frozen=True, eq=False)
class CompiledShape:
    """A compiled shape with the statements of its shapes graph (for ``report``)."""

    shape: Shape
    statements: Mapping[Node, Statements]
    texts: TermTexts

    def check(self, data: Data, focus: Term) -> list[Violation]:
        """Return at most MOST violations of ``focus``; none if it conforms."""
        if self.shape.conforms(data, focus):
            return []
        found = list(islice(self.shape.violations(data, focus, Run(self.texts)), MOST))
        assert found, "a shape that refuses says why"
        return found


@dataclass(frozen=True, eq=False)
class CompiledGraph:
    """The shapes of a graph that have targets, each with a function that finds its focus nodes in data."""

    shapes: Sequence[tuple[CompiledShape, Callable[[Data], Iterable[Term]]]]

    def check(self, data: Data) -> list[Violation]:
        """Return the violations of all focus nodes, at most MOST for each focus node and shape."""
        return [
            found for shape, targets in self.shapes for focus in targets(data) for found in shape.check(data, focus)
        ]
