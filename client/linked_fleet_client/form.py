"""Forms derived from shapes, with names, units and limits, and the request bodies built from them."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from rdflib import BNode, Graph
from rdflib.term import Literal, Node, URIRef

from linked_fleet_client.errors import InvalidInput
from linked_fleet_client.quantity import NUMBERS, UNIT_PATHS, Quantity, literal, matching_unit, unit_label
from linked_fleet_client.shape import Bound, Field, Shape, conjunction, with_branches
from linked_fleet_client.vocabulary import RDF, SH, is_web, local_name

Find = Callable[[str], URIRef | None]
"""Returns the IRI of a thing by name, such as a joint; None if there is none."""


@dataclass(frozen=True)
class Limits:
    """A numeric range and its condition: the values that other fields must have, by name; empty if it always holds."""

    lower: Bound | None
    upper: Bound | None
    when: Mapping[str, tuple[Node, ...]] = field(default_factory=dict)


@dataclass(frozen=True)
class FormField:
    """One field to fill in. ``choices`` is None if any value is valid; ``fields`` are the fields of a nested node."""

    name: str
    path: URIRef
    description: str
    datatypes: tuple[URIRef, ...]
    choices: tuple[Node, ...] | None
    min_count: int
    max_count: int | None
    limits: tuple[Limits, ...]
    fields: tuple["FormField", ...]
    default: Node | None
    fixed: bool

    @property
    def required(self) -> bool:
        return self.min_count > 0 and not self.fixed and self.default is None


def form_fields(shape: Shape) -> tuple[FormField, ...]:
    """Return the fields of a shape and of its alternatives: choices merged, each limit with its condition."""
    branches = [branch for group in shape.alternatives for branch in group]
    fields = all_fields(shape)
    names = {each.path: each.name for each in fields}
    return tuple(_form_field(each, branches, names) for each in fields)


def all_fields(shape: Shape) -> tuple[Field, ...]:
    """Return the fields of the shape, followed by those of alternatives only, which are optional."""
    own = {each.path: each for each in shape.fields}
    for branch in (branch for group in shape.alternatives for branch in group):
        for each in branch.fields:
            own.setdefault(
                each.path, Field(each.path, each.name, each.shape, each.description, max_count=each.max_count)
            )
    return tuple(own.values())


def _form_field(own: Field, branches: Sequence[Shape], names: Mapping[URIRef, str]) -> FormField:
    there = [(branch, found) for branch in branches if (found := branch.field(own.path))]
    nested = conjunction([own.shape, *(found.shape for _, found in there if found.shape.fields)])
    bounded = [(None, own), *there]
    limits = [
        Limits(found.shape.lower, found.shape.upper, _conditions(branch, own.path, names) if branch else {})
        for branch, found in bounded
        if found.shape.lower or found.shape.upper
    ]
    return FormField(
        name=own.name,
        path=own.path,
        description=own.description,
        datatypes=own.shape.datatypes,
        choices=choices(own, branches),
        min_count=own.min_count,
        max_count=own.max_count,
        limits=tuple(limits),
        fields=form_fields(nested),
        default=own.default,
        fixed=bool(own.fixed),
    )


def choices(own: Field, branches: Iterable[Shape]) -> tuple[Node, ...] | None:
    """Return the values that the field may have: its own, else all that any branch or alternative allows."""
    if own.allowed is not None:
        return own.allowed
    found = [each.allowed for branch in branches if (each := branch.field(own.path))]
    found += [branch.choices for group in own.shape.alternatives for branch in group]
    known = [each for each in found if each is not None]
    return tuple(dict.fromkeys(each for allowed in known for each in allowed)) if known else None


def _conditions(branch: Shape, path: URIRef, names: Mapping[URIRef, str]) -> dict[str, tuple[Node, ...]]:
    others = [each for each in branch.fields if each.path != path]
    return {names[each.path]: each.allowed for each in others if each.allowed is not None}


def build(shape: Shape, given: Mapping[str, Any], find: Find) -> Graph:
    """Return the body with the values ``given`` by field name. Raises InvalidInput with all errors."""
    writer = _Writer(Graph(), find)
    writer.node(shape, given, "")
    if writer.wrong:
        raise InvalidInput(writer.wrong)
    return writer.graph


class _Writer:
    """Writes nodes into one graph. It collects all errors instead of stopping at the first."""

    def __init__(self, graph: Graph, find: Find) -> None:
        self.graph, self.find = graph, find
        self.wrong: list[str] = []

    def node(self, shape: Shape, given: Mapping[str, Any], where: str) -> Node:
        """Add a node and return it; ``where`` is its path in messages."""
        node = BNode()
        values, scale = self._chosen(shape, self._by_path(shape, given, where), where)
        refused = {path for path, offered in values.items() if not offered}
        taken = self._branches(shape, values, where)
        whole = with_branches(shape, taken)
        for type_ in whole.classes:
            self.graph.add((node, RDF.type, type_))
        for each in all_fields(whole):
            offered = self._values(each, values.get(each.path, []))
            if each.path not in refused:
                self._count(each, offered, where + each.name)
            for index, value in enumerate(offered):
                name = where + each.name + (f"[{index}]" if len(offered) > 1 else "")
                term = self._term(each, value, name, scale if _is_number(each) else 1.0)
                if term is not None:
                    self.graph.add((node, each.path, term))
        return node

    def _by_path(self, shape: Shape, given: Mapping[str, Any], where: str) -> dict[URIRef, list[Any]]:
        fields = all_fields(shape)
        found: dict[URIRef, list[Any]] = {}
        for name, value in given.items():
            path = _named(fields, name)
            if path is None:
                there = ", ".join(each.name for each in fields) or "nothing"
                self.wrong.append(f"{where}{name}: there is no such field; there is {there}")
            elif value is not None:
                found[path] = list(value) if isinstance(value, list | tuple | set) else [value]
        return {path: offered for path, offered in found.items() if offered}

    def _chosen(
        self, shape: Shape, values: dict[URIRef, list[Any]], where: str
    ) -> tuple[dict[URIRef, list[Any]], float]:
        """Return the values with names of choices resolved, and the factor that converts numbers to the chosen unit.

        Units are resolved last, so that only those compatible with the other choices are offered.
        """
        branches = [branch for group in shape.alternatives for branch in group]
        scale = 1.0
        for each in sorted(all_fields(shape), key=lambda each: each.path in UNIT_PATHS):
            there = choices(each, _alive(branches, values))
            if each.path not in values or there is None:
                continue
            picked = [self._pick(value, there, where + each.name) for value in values[each.path]]
            values[each.path] = [term for term, _ in picked if term is not None]
            scale *= next((factor for _, factor in picked), 1.0)
        return values, scale

    def _pick(self, value: Any, there: tuple[Node, ...], name: str) -> tuple[Node | None, float]:
        text = str(getattr(value, "iri", value))
        for choice in there:
            if text == str(choice) or (isinstance(choice, Literal) and choice.toPython() == value):
                return choice, 1.0
        iris = [choice for choice in there if isinstance(choice, URIRef)]
        unit = matching_unit(text, iris)
        if unit is None and (found := self.find(text)) in iris:
            unit = (URIRef(str(found)), 1.0)
        if unit is None:
            self.wrong.append(f"{name}: {text!r} is none of {choices_text(there)}")
        return unit or (None, 1.0)

    def _branches(self, shape: Shape, values: Mapping[URIRef, list[Any]], where: str) -> list[Shape]:
        """Return for each group of alternatives the branch that the values select, if they select exactly one."""
        taken = []
        for group in shape.alternatives:
            alive = _alive(group, values)
            if not alive and not self.wrong:
                self.wrong.append(f"{where or 'input'}: these values do not go together")
            taken += alive if len(alive) == 1 else []
        return taken

    def _values(self, each: Field, given: list[Any]) -> list[Any]:
        if each.fixed:
            return list(dict.fromkeys([*each.fixed, *given]))
        if given or each.min_count == 0:
            return given
        sole = each.shape.choices
        if sole is not None and len(sole) == 1:
            return list(sole)
        return [] if each.default is None else [each.default]

    def _count(self, each: Field, offered: Sequence[Any], name: str) -> None:
        if len(offered) < each.min_count:
            which = f": one of {choices_text(each.allowed)}" if each.allowed else ""
            much = "is missing" if not offered else f"is needed {each.min_count} times"
            self.wrong.append(f"{name} {much}{which}")
        if each.max_count is not None and len(offered) > each.max_count:
            self.wrong.append(f"{name} is given {len(offered)} times; at most {each.max_count} are allowed")

    def _term(self, each: Field, value: Any, name: str, scale: float) -> Node | None:
        if isinstance(value, URIRef | Literal):
            return value
        if each.shape.fields or each.shape.alternatives:
            nested = _parts_of(value, each.shape)
            if nested is not None:
                return self.node(each.shape, nested, name + ".")
        if isinstance(iri := getattr(value, "iri", None), URIRef):
            return iri
        if each.shape.node_kind in (SH.IRI, SH.BlankNodeOrIRI) or each.shape.classes:
            return self._iri(str(value), name)
        try:
            term = literal(value, each.shape.datatypes, scale, bool(each.shape.lower or each.shape.upper))
        except ValueError as error:
            self.wrong.append(f"{name}: {error}")
            return None
        self._within(term, each.shape, name)
        return term

    def _iri(self, text: str, name: str) -> URIRef | None:
        found = URIRef(text) if is_web(URIRef(text)) or text.startswith("urn:") else self.find(text)
        if found is None:
            self.wrong.append(f"{name}: nothing is called {text!r}; give its name or its IRI")
        return found

    def _within(self, term: Literal, shape: Shape, name: str) -> None:
        value = float(term) if shape.lower or shape.upper else 0.0
        low = shape.lower and (value < shape.lower.value or (value == shape.lower.value and not shape.lower.inclusive))
        high = shape.upper and (value > shape.upper.value or (value == shape.upper.value and not shape.upper.inclusive))
        if low or high:
            self.wrong.append(f"{name}: {value:.9g} is not {range_text(shape.lower, shape.upper)}")


def _alive(branches: Iterable[Shape], values: Mapping[URIRef, list[Any]]) -> list[Shape]:
    """Return the branches that are compatible with the values chosen so far."""

    def allows(branch: Shape) -> bool:
        known = [(each.allowed, values[each.path]) for each in branch.fields if each.path in values]
        return all(
            value in allowed
            for allowed, given in known
            if allowed is not None
            for value in given
            if isinstance(value, URIRef | Literal)
        )

    return [branch for branch in branches if allows(branch)]


def _named(fields: Sequence[Field], name: str) -> URIRef | None:
    exact = [each.path for each in fields if name in (each.name, str(each.path))]
    alike = [each.path for each in fields if name.casefold() in map(str.casefold, (each.name, local_name(each.path)))]
    return next(iter(exact + alike), None)


def _parts_of(value: Any, shape: Shape) -> Mapping[str, Any] | None:
    """Return the parts of a nested node: a mapping unchanged, a quantity as its number and its unit, a number alone."""
    if isinstance(value, Mapping):
        return value
    if _is_plain_number(value):
        numbers = [each for each in all_fields(shape) if each.path in NUMBERS]
        return {str(each.path): value for each in numbers} if len(numbers) == 1 else None
    if isinstance(value, Quantity):
        said = [(NUMBERS, value.number), (UNIT_PATHS, value.unit)]
        return {str(each.path): part for each in all_fields(shape) for paths, part in said if each.path in paths}
    return None


def _is_plain_number(value: Any) -> bool:
    if isinstance(value, str):
        try:
            float(value)
        except ValueError:
            return False
        return True
    return isinstance(value, int | float) and not isinstance(value, bool)


def _is_number(each: Field) -> bool:
    return each.path in NUMBERS


def choices_text(choices: Iterable[Node]) -> str:
    """Return the choices as text. A choice with several IRIs, such as a unit, appears once."""
    words = dict.fromkeys(unit_label(str(choice)) if isinstance(choice, URIRef) else str(choice) for choice in choices)
    return ", ".join(word or "unitless" for word in words)


def range_text(lower: Bound | None, upper: Bound | None) -> str:
    """Return the range as text, such as ``from 0 to less than 360``."""
    low = f"{'from' if lower.inclusive else 'more than'} {lower.value:.9g}" if lower else ""
    high = f"{'at most' if upper.inclusive else 'less than'} {upper.value:.9g}" if upper else ""
    return f"{low} to {high.removeprefix('at most ')}" if low and high else low or high
