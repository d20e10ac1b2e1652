"""JSON forms: the members of JSON objects, and their JSON Schemas (W3C WoT Thing Description 1.1, 5.3.2)."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

from pyoxigraph import NamedNode, Triple

from linked_fleet_rdf.graph import Term

Json = dict[str, Any]


@dataclass(frozen=True)
class Value:
    """The form of one value of a property: an object if there is a ``form``, else a scalar."""

    scalar: Json = field(default_factory=dict)
    form: "Form | None" = None
    terms: Mapping[str, Term] = field(default_factory=dict)
    """The terms of an enumeration by their JSON texts."""
    nullable: bool = False
    """True if it may be ``null``, which means ``lf:unknown``."""
    datatype: NamedNode | None = None
    """The datatype of a JSON string, if that is no plain text, such as ``xsd:dateTime``."""
    numeric: tuple[NamedNode, ...] = ()
    """The datatypes of numbers that the shape allows; any if there are none."""

    @property
    def is_iri(self) -> bool:
        return self.scalar.get("format") == "uri" and self.datatype is None

    def schema(self) -> Json:
        known = self.form.schema if self.form is not None else self.scalar
        return {"oneOf": [known, {"type": "null"}]} if self.nullable else known


@dataclass(frozen=True)
class Field:
    """One member of an object: its path from the node, and the form of its values."""

    name: str
    path: tuple[NamedNode, ...]
    value: Value
    min_count: int = 0
    max_count: int | None = None
    description: str = ""

    @property
    def is_single(self) -> bool:
        return self.max_count == 1

    def schema(self) -> Json:
        one = self.value.schema()
        if self.is_single:
            schema = dict(one)
        else:
            schema = {"type": "array", "items": one}
            schema |= {"minItems": self.min_count} if self.min_count else {}
            schema |= {} if self.max_count is None else {"maxItems": self.max_count}
        return schema | ({"description": self.description} if self.description else {})


@dataclass(frozen=True)
class Form:
    """A node as a JSON object; if there are ``branches``, one of them must hold too."""

    fields: tuple[Field, ...] = ()
    branches: tuple["Form", ...] = ()

    @cached_property
    def by_name(self) -> Mapping[str, Field]:
        return {each.name: each for each in self.fields}

    def with_choice(self, name: str, predicate: NamedNode, terms: Mapping[str, NamedNode], description: str) -> "Form":
        """Return the form with one more optional member, whose value is one of these terms by their JSON texts."""
        value = Value({"type": "string", "enum": list(terms)}, terms=terms)
        member = Field(name, (predicate,), value, max_count=1, description=description)
        return Form((*self.fields, member), self.branches)

    @cached_property
    def schema(self) -> Json:
        schema: Json = {"type": "object", "properties": {each.name: each.schema() for each in self.fields}}
        required = [each.name for each in self.fields if each.min_count]
        if required:
            schema["required"] = required
        if self.branches:
            schema["oneOf"] = [{"properties": branch.schema["properties"]} for branch in self.branches]
        return schema

    def schema_with(self, members: Mapping[str, Json]) -> Json:
        """Return the schema with further members, which an object may lack."""
        return self.schema | {"properties": self.schema["properties"] | members} if members else self.schema


@dataclass(frozen=True, eq=False)
class DeclaredForm(Form):
    """The form of what a robot has declared as a JSON Schema itself.

    ``read`` converts a JSON body for the resource with an IRI into at most so many triples. Raises as
    ``plain_json.parse_json_body``.
    """

    declared: Json = field(default_factory=dict)
    read: Callable[[bytes, str, int], list[Triple]] = lambda body, iri, most: []

    @property
    def schema(self) -> Json:
        return self.declared
