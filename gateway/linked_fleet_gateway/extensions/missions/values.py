"""Values of a run: of its parameters and of the results of its steps, and bodies of actions with them. Pure."""

import json
from collections.abc import Iterator, Mapping
from typing import Any

from pyoxigraph import Literal, NamedNode, Triple

from linked_fleet_gateway.api import UnprocessableContent
from linked_fleet_gateway.extensions.missions.mission import Invoke, Mission, Parameter, Variable, step_at
from linked_fleet_gateway.extensions.missions.record import Run
from linked_fleet_gateway.extensions.rules.template import fill, variables
from linked_fleet_rdf.vocabulary import XSD

Value = float | bool | str
DATATYPES = {"number": XSD.double, "integer": XSD.integer, "boolean": XSD.boolean, "text": XSD.string}


def term(value: Value, kind: str) -> NamedNode | Literal:
    """Return a value as an RDF term."""
    if kind == "iri":
        return NamedNode(str(value))
    return Literal(json.dumps(value) if kind != "text" else str(value), datatype=DATATYPES[kind])


def value_of(term_: NamedNode | Literal, kind: str) -> Value:
    """Return the JSON value of a term. Raises ValueError."""
    if kind in ("iri", "text"):
        return term_.value
    if kind == "boolean":
        return term_.value in ("true", "1")
    number = float(term_.value)
    return int(number) if kind == "integer" else number


def known_values(run: Run) -> dict[str, tuple[Value, str]]:
    """Return the values that steps may refer to, with their kinds: parameters, and members of results."""
    kinds = {each.name: each.type for each in run.mission.parameters}
    found: dict[str, tuple[Value, str]] = {name: (value, kinds[name]) for name, value in run.values.items()}
    names = _paths_by_name(run)
    for name, path in names.items():
        for member, value in _results(run.steps[path].result).items():
            found[f"{name}.{member}"] = value, _kind(value)
    return found


def _paths_by_name(run: Run) -> dict[str, str]:
    """Return the paths of the named steps that have ended; of the last round if there are several."""
    named = {}
    for path in run.steps:
        step = step_at(run.mission.step, path)
        if step.name:
            named[step.name] = path
    return named


def _results(text: str) -> dict[str, Value]:
    given = json.loads(text) if text else {}
    return {name: value for name, value in given.items() if isinstance(value, float | int | bool | str)}


def _kind(value: Value) -> str:
    return "boolean" if isinstance(value, bool) else "text" if isinstance(value, str) else "number"


def json_body(body: Mapping[str, Any], values: Mapping[str, tuple[Value, str]]) -> dict[str, Any]:
    """Return a body in plain JSON with values in place of its variables. Raises UnprocessableContent."""
    filled = _filled(body, values)
    assert isinstance(filled, dict)
    return filled


def _filled(given: Any, values: Mapping[str, tuple[Value, str]]) -> Any:
    if isinstance(given, dict):
        if given.keys() == {"variable"}:
            return _value(str(given["variable"]), values)[0]
        return {name: _filled(each, values) for name, each in given.items()}
    return [_filled(each, values) for each in given] if isinstance(given, list) else given


def rdf_body(template: str, values: Mapping[str, tuple[Value, str]], action: NamedNode) -> list[Triple]:
    """Return a body as triples with values in place of its variables. Raises UnprocessableContent."""
    row = {name: term(*_value(name, values)) for name in variables(template)}
    return fill(template, row, action)


def _value(name: str, values: Mapping[str, tuple[Value, str]]) -> tuple[Value, str]:
    if name not in values:
        raise UnprocessableContent(f"The variable {name[:130]} has no value: the step that it is of gave none.")
    return values[name]


def variables_of(step: Invoke) -> set[str]:
    """Return the variables that a step refers to."""
    found = {step.of.variable} if isinstance(step.of, Variable) else set()
    return found | (variables(step.triples) if step.triples else set()) | _json_variables(step.body or {})


def _json_variables(given: Any) -> set[str]:
    objects = (each for each in values_in(given) if isinstance(each, dict))
    return {str(each["variable"]) for each in objects if each.keys() == {"variable"}}


def values_in(given: Any) -> Iterator[Any]:
    """Yield a JSON value, and all values in it."""
    yield given
    for each in given.values() if isinstance(given, dict) else given if isinstance(given, list) else ():
        yield from values_in(each)


def sample(parameter: Parameter) -> Value:
    """Return a value that a parameter may have, for checks before anybody has given one."""
    if parameter.default is not None:
        return parameter.default
    if parameter.options:
        return parameter.options[0]
    if parameter.type in ("number", "integer"):
        low, high = parameter.minimum, parameter.maximum
        middle = (low + high) / 2 if low is not None and high is not None else low if low is not None else high or 0.0
        return int(middle) if parameter.type == "integer" else middle
    return False if parameter.type == "boolean" else "https://example.org/" if parameter.type == "iri" else "text"


def samples(mission: Mission) -> dict[str, tuple[Value, str]]:
    """Return a value for each parameter of a mission, with its kind: its default if it has one."""
    return {each.name: (sample(each), each.type) for each in mission.parameters}


def is_free(parameter: Parameter) -> bool:
    """Return True if no sample of a parameter stands for its values: a text or an IRI of any kind."""
    return parameter.type in ("text", "iri") and parameter.default is None and not parameter.options
