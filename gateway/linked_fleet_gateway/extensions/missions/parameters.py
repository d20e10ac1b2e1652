"""The parameters of a mission as the input of its action ``run``: a shape of its own, with a term for each. Pure."""

import math
from collections.abc import Callable, Iterable, Set
from dataclasses import dataclass, field
from decimal import Decimal

from pyoxigraph import Literal, NamedNode

from linked_fleet_gateway.api import Body, Graph, UnprocessableContent, integer
from linked_fleet_gateway.extensions.missions.mission import Mission, Parameter
from linked_fleet_gateway.extensions.missions.terms import LF
from linked_fleet_gateway.extensions.missions.values import DATATYPES, Value, term, value_of
from linked_fleet_gateway.faces import ActionDefinition, Offer
from linked_fleet_rdf.graph import Node
from linked_fleet_rdf.vocabulary import METHODS, NUMERIC, SH, XSD

RUN = "run"
_DEFAULT = SH.extended("defaultValue").defaultValue


def check_value(parameter: Parameter, value: Value) -> Value:
    """Return a value that a parameter may have. Raises UnprocessableContent."""
    name = parameter.name
    if not isinstance(value, _WANTED[parameter.type]) or isinstance(value, bool) != (parameter.type == "boolean"):
        raise UnprocessableContent(f"The value of {name} is of the type {parameter.type}, not {value!r:.60}.")
    if parameter.type == "iri":
        check_iri(str(value), f"The value of {name}")
    low, high = parameter.minimum, parameter.maximum
    if parameter.type in ("number", "integer") and not _is_within(float(value), low, high):
        bounds = f"{'' if low is None else f'from {low:g} '}{'' if high is None else f'to {high:g}'}"
        raise UnprocessableContent(f"The value of {name} is a finite number {bounds}, not {value}.")
    if parameter.options and value not in parameter.options:
        raise UnprocessableContent(f"The value of {name} is one of {', '.join(parameter.options)[:500]}.")
    return value


_WANTED: dict[str, tuple[type, ...]] = {
    "number": (int, float), "integer": (int,), "boolean": (bool,), "text": (str,), "iri": (str,),
}  # fmt: skip


def _is_within(value: float, low: float | None, high: float | None) -> bool:
    return math.isfinite(value) and (low is None or value >= low) and (high is None or value <= high)


def check_iri(text: str, who: str) -> None:
    """Raise UnprocessableContent for a text that is no IRI; none is fine."""
    try:
        if text:
            NamedNode(text)
    except ValueError as error:
        raise UnprocessableContent(f"{who} names {text[:100]!r}, which is no IRI: {error}.") from error


def predicate_of(mission: str, name: str) -> NamedNode:
    """Return the predicate of a parameter's value; ``mission`` is the IRI of the mission."""
    return NamedNode(f"{mission}#{name}")


def read_values(body: Body, mission: Mission, iri: str) -> dict[str, Value]:
    """Return the values that a body gives to the parameters, with their defaults. Raises UnprocessableContent."""
    found = dict[str, Value]()
    for each in mission.parameters:
        given = [
            triple.object
            for triple in body.triples
            if triple.subject == body.root and triple.predicate == predicate_of(iri, each.name)
        ]
        if given and isinstance(given[0], NamedNode | Literal):
            found[each.name] = check_value(each, value_of(given[0], each.type))
        elif each.default is not None:
            found[each.name] = each.default
        else:
            raise UnprocessableContent(f"The parameter {each.name} has no value, and no default.")
    return found


@dataclass(frozen=True)
class RunOffer(Offer):
    """The action ``run`` of a mission, whose input are its parameters."""

    mission: Mission = field(kw_only=True)
    acts_on: Callable[[Mission], Set[str] | None] = field(kw_only=True)
    """Returns the robots that its steps may move; None for any."""

    @property
    def robots(self) -> Set[str] | None:
        return self.acts_on(self.mission)

    @property
    def template_key(self) -> object:
        return None

    @property
    def declared_by(self) -> str:
        return self.thing

    @property
    def values(self) -> tuple[Literal, ...]:
        return (Literal(self.name),)

    @property
    def body_is_optional(self) -> bool:
        return all(each.default is not None for each in self.mission.parameters)

    def _consumes(self, graph: Graph, base: str, numbers: Iterable[Literal]) -> Node:
        node = graph.blank(SH.NodeShape)
        for each in self.mission.parameters:
            graph.add(node, SH.property, _shape(graph, each, predicate_of(base + self.thing, each.name)))
        return node


def _shape(graph: Graph, parameter: Parameter, predicate: NamedNode) -> Node:
    node = graph.blank()
    graph.add(node, SH.path, predicate)
    graph.add(node, SH.name, Literal(parameter.name))
    if parameter.title:
        graph.add(node, SH.description, Literal(parameter.title))
    if parameter.default is None:
        graph.add(node, SH.minCount, integer(1))
    graph.add(node, SH.maxCount, integer(1))
    if parameter.type == "iri":
        graph.add(node, SH.nodeKind, SH.IRI)
    elif parameter.type == "number":
        choices = []
        for each in NUMERIC:
            choice = graph.blank()
            graph.add(choice, SH.datatype, each)
            choices.append(choice)
        graph.add(node, SH.or_, graph.collection(choices))
    else:
        graph.add(node, SH.datatype, DATATYPES[parameter.type])
    for bound, number in ((SH.minInclusive, parameter.minimum), (SH.maxInclusive, parameter.maximum)):
        if number is not None:
            # A decimal: validators compare the decimals that people write with it exactly.
            graph.add(node, bound, Literal(format(Decimal(repr(number)), "f"), datatype=XSD.decimal))
    if parameter.default is not None:
        graph.add(node, _DEFAULT, term(parameter.default, parameter.type))
    if parameter.options:
        graph.add(node, SH.in_, graph.collection([term(each, parameter.type) for each in parameter.options]))
    return node


class RunDefinitions:
    """The definitions of the actions ``run``, one for each mission as it is, so that its shape is compiled once."""

    def __init__(self) -> None:
        self._known: dict[str, tuple[Mission, ActionDefinition]] = {}

    def of(self, path: str, mission: Mission) -> ActionDefinition:
        """Return the definition for the mission at a path, another one after a change of the mission."""
        held = self._known.get(path)
        if held is None or held[0] is not mission:
            held = self._known[path] = mission, _definition(mission)
            if len(self._known) > _MOST_DEFINITIONS:
                del self._known[next(iter(self._known))]
        return held[1]


_MOST_DEFINITIONS = 1024


def _definition(mission: Mission) -> ActionDefinition:
    return ActionDefinition(
        iri=LF.RunMission,
        segment=RUN,
        title="Run",
        comment="Runs the mission.",
        offered_by=frozenset(),
        offered_if=(),
        capability="",
        methods=(METHODS.POST,),
        consumes=LF.RunMission if mission.parameters else None,
        produces=LF.InvocationShape,
    )
