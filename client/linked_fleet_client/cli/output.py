"""Text for people and JSON for scripts. Control characters from the network are removed."""

import json
from collections.abc import Iterable, Mapping, Sequence
from datetime import datetime
from typing import Any

from rdflib.term import Literal, Node, URIRef

from linked_fleet_client.errors import InvalidInput
from linked_fleet_client.form import FormField, Limits, choices_text, range_text
from linked_fleet_client.quantity import Quantity, number
from linked_fleet_client.reading import Reading, Value
from linked_fleet_client.resource import step
from linked_fleet_client.vocabulary import local_name

_WIDEST = 72


def clean(text: str) -> str:
    """Replace characters that would control the terminal."""
    return "".join(each if each.isprintable() else " " for each in text)


def table(rows: Sequence[Sequence[str]], header: Sequence[str] = ()) -> str:
    """Return rows as columns of equal width, two spaces apart."""
    cells = [[clean(cell) for cell in row] for row in ([header] if header else []) + list(rows)]
    widths = [max((len(row[column]) for row in cells), default=0) for column in range(len(cells[0]) if cells else 0)]
    return "\n".join("  ".join(map(str.ljust, row, widths)).rstrip() for row in cells)


def convert(value: Quantity, units: Sequence[str]) -> Quantity:
    """Convert to the first of ``units`` with the same dimension; return the value unchanged if there is none."""
    for unit in units:
        try:
            return value.to(unit)
        except InvalidInput:
            continue  # a unit of another dimension is for other values
    return value


def value_text(value: Value, units: Sequence[str] = ()) -> str:
    if isinstance(value, Quantity):
        return str(convert(value, units))
    if isinstance(value, bool):
        return "true" if value else "false"
    return local_name(value) if isinstance(value, URIRef) else value


def one_line(reading: Reading, units: Sequence[str] = ()) -> str:
    """Return the values on one line: the main one, or as many as fit."""
    if reading.main is not None:
        return value_text(reading.main, units)
    text = ", ".join(f"{key}={value_text(value, units)}" for key, value in reading.values.items())
    return text if len(text) <= _WIDEST else text[: _WIDEST - 4] + " ..."


def input_text(fields: Sequence[FormField], indent: str = "") -> list[str]:
    """Return one line for each field, followed by indented lines for nested fields."""
    lines = []
    for each in fields:
        if each.fixed and not each.fields:
            continue  # filled in automatically
        parts = [f"{indent}{each.name}", _kind(each), _counts(each), each.description]
        lines.append(clean("  ".join(part for part in parts if part)))
        lines += [clean(f"{indent}    {_limits(limits)}") for limits in each.limits[:_MOST]]
        more = len(each.limits) - _MOST
        lines += [f"{indent}    and {more} more ranges"] if more > 0 else []
        lines += input_text(each.fields, indent + "    ")
    return lines


_MOST = 40


def _kind(each: FormField) -> str:
    if each.choices is not None:
        return f"one of {choices_text(each.choices)}"
    if each.fields:
        return "made of"
    names = list(dict.fromkeys("number" if _numeric(datatype) else local_name(datatype) for datatype in each.datatypes))
    return " or ".join(names) or ("number" if each.limits else "")


def _counts(each: FormField) -> str:
    if each.max_count == 1:
        return "" if each.min_count else "(optional)"
    most = "any number of times" if each.max_count is None else f"up to {each.max_count} times"
    return f"({'at least once, ' if each.min_count else ''}{most})"


def _limits(limits: Limits) -> str:
    when = ", ".join(f"{name} {choices_text(choices)}" for name, choices in limits.when.items())
    return range_text(limits.lower, limits.upper) + (f" for {when}" if when else "")


def _numeric(datatype: URIRef) -> bool:
    return number(Literal("1", datatype=datatype)) == 1.0


def as_json(value: Any) -> str:
    return json.dumps(value, ensure_ascii=True, default=_plain)


def _plain(value: Any) -> Any:
    if isinstance(value, Quantity):
        return quantity(value)
    return value.isoformat() if isinstance(value, datetime) else str(value)


def quantity(value: Quantity) -> dict[str, Any]:
    """Return the JSON form; ``number`` is null if the value is unknown."""
    time = {"time": value.time.isoformat()} if value.time else {}
    return {"number": value.number, "unit": value.unit_label, "unitIRI": value.unit, **time}


def reading(found: Reading, units: Sequence[str] = ()) -> dict[str, Any]:
    return {
        key: quantity(convert(value, units)) if isinstance(value, Quantity) else str(value)
        for key, value in found.values.items()
    }


def fields_json(fields: Iterable[FormField]) -> list[dict[str, Any]]:
    return [
        {
            "name": each.name,
            "path": str(each.path),
            "description": each.description,
            "datatypes": [str(datatype) for datatype in each.datatypes],
            "choices": None if each.choices is None else [str(choice) for choice in each.choices],
            "minCount": each.min_count,
            "maxCount": each.max_count,
            "limits": [_limits_json(limits) for limits in each.limits],
            "fields": fields_json(each.fields),
        }
        for each in fields
    ]


def _limits_json(limits: Limits) -> dict[str, Any]:
    bounds = {"lower": limits.lower, "upper": limits.upper}
    known = {name: {"value": bound.value, "inclusive": bound.inclusive} for name, bound in bounds.items() if bound}
    return {**known, "when": {name: [str(choice) for choice in choices] for name, choices in limits.when.items()}}


def path_of(above: str, name: str) -> str:
    return f"{above.rstrip('/')}/{step(name)}".lstrip("/")


def statements(pairs: Iterable[tuple[Node, Node]]) -> Mapping[str, list[str]]:
    """Return objects by the local name of their predicate."""
    found: dict[str, list[str]] = {}
    for predicate, value in pairs:
        found.setdefault(local_name(str(predicate)), []).append(str(value))
    return found
