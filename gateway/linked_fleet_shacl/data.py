"""The data graph of a compiled shape: triples by subject and predicate, and evaluation of paths."""

import math
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence, Set

from pyoxigraph import Literal, NamedNode, Triple

from linked_fleet_shacl.terms import RDF, RDFS, Node, Number, Term, number

Reach = Callable[["Data", Term], Collection[Term]]


class Data:
    """A set of triples (by RDF term equality) with cached results."""

    def __init__(self, triples: Sequence[Triple]) -> None:
        self._forward: dict[object, dict[NamedNode, list[Term]]] = {}
        self._backward: dict[tuple[object, NamedNode], list[Term]] | None = None
        self._numbers: dict[Literal, Number | None] = {}
        self._classes: dict[Term, Set[Term]] = {}
        self.verdicts: dict[tuple[object, Term], bool] = {}  # by shape and focus, so that each pair is checked once
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

    def statements(self, subject: Term) -> Mapping[NamedNode, Sequence[Term]]:
        return self._forward.get(subject, {})

    def nodes(self) -> Iterable[Node]:
        """Return all subjects."""
        return self._forward  # type: ignore[return-value]

    def subject_objects(self, predicate: Term) -> Iterable[tuple[Node, Term]]:
        """Yield the subjects and objects of a predicate."""
        for subject, about in self._forward.items():
            for value in about.get(predicate, ()):  # type: ignore[arg-type]
                yield subject, value  # type: ignore[misc]

    def is_a(self, node: Term, wanted: Term) -> bool:
        """Return True for an instance of a class or of a subclass according to the data (SHACL 1.1)."""
        types = self.objects(node, RDF.type)
        if not types or wanted in types:
            return bool(types)
        return not self.subclasses(wanted).isdisjoint(types)

    def subclasses(self, wanted: Term) -> Set[Term]:
        """Return a class and its subclasses according to the data."""
        if wanted not in self._classes:
            self._classes[wanted] = frozenset(_subclasses(self, wanted))
        return self._classes[wanted]

    def number(self, literal: Literal) -> Number | None:
        """Return the value of a well-typed numeric literal; None for other literals."""
        try:
            return self._numbers[literal]
        except KeyError:
            value = self._numbers[literal] = number(literal)
            return value


def comparable_number(term: Term, data: Data) -> Number | None:
    """Return the number that limits apply to; None for a term that is not comparable, such as NaN."""
    if not isinstance(term, Literal):
        return None
    value = data.number(term)
    return None if isinstance(value, float) and math.isnan(value) else value


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
    """Return the path ``sh:zeroOrMorePath`` or ``sh:oneOrMorePath``, which yields each reachable node once."""

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


_subclasses = repeated_path(inverse_path(RDFS.subClassOf), with_focus=True)
