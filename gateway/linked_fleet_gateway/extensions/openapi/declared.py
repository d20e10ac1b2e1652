"""Schemas of what single things declare, such as components and missions; those of one name may differ in all."""

import json
import re
from collections.abc import Iterable, Sequence

from linked_fleet_gateway.faces import Json, Offer, Property, form_of

_MOST_SCHEMAS = 16
_BESIDE = [
    (before, after) for before in ("", "Cancel") for after in ("", "Input", "Body", "Blueprint", "Links", "Invocation")
]


class Names:
    """Makes names of operations and schemas, each once. Others are derived from them by prefixes and suffixes."""

    def __init__(self) -> None:
        self._taken = set[str]()

    def new(self, wanted: str) -> str:
        """Return the wanted name with the characters that names may have; with a number if it is taken."""
        plain = re.sub(r"[^A-Za-z0-9]", "_", wanted)
        name, number = plain, 1
        while not self._taken.isdisjoint(derived := {before + name + after for before, after in _BESIDE}):
            number += 1
            name = f"{plain}{number}"
        self._taken |= derived
        return name


def any_of(schemas: Iterable[Json]) -> Json:
    """Return a schema that accepts what one of the schemas accepts; anything if they are too many to list."""
    found = {json.dumps(each, sort_keys=True): each for each in schemas}
    if len(found) == 1:
        return next(iter(found.values()))
    return {"anyOf": list(found.values())} if len(found) <= _MOST_SCHEMAS else {}


def read_schema(items: Sequence[Property]) -> Json | None:
    """Return the schema of properties in plain JSON; None if they have none."""
    schemas = [each.form.schema for each in items if each.form is not None]
    if (shared := next((each.shape for each in items if each.form is None), None)) is not None:
        form = form_of(shared)
        if not form.fields:
            return None
        schemas.append(form.schema)
    return any_of(schemas)


def outcome_members(offers: Iterable[Offer]) -> dict[str, Json]:
    """Return the schemas of what the invocations of one of these actions may have beside those of all actions."""
    found: dict[str, list[Json]] = {}
    for offer in offers:
        for name, schema in offer.outcome_members.items():
            found.setdefault(name, []).append(schema)
    return {name: any_of(schemas) for name, schemas in found.items()}


def is_declared(offer: Offer) -> bool:
    return bool(offer.declared_by)


def may_lack_body(offer: Offer) -> bool:
    return not offer.takes_body or offer.body_is_optional
