"""Places of declared values: a schema, and the predicate that links its value to the node of its owner.

The predicate is the ``@type`` of the schema, else a term of the robot's own vocabulary:

    <robot>/vocabulary#{component}-{kind}-{name}-{member}…

Names are escaped so that no two places share a term. Two members of one object with the same ``@type`` would become one
in RDF, so each is linked by its own term, which the vocabulary describes as a subproperty of the ``@type``.
"""

import re
from collections import Counter
from collections.abc import Mapping
from typing import Literal

from msgspec import Struct
from pyoxigraph import NamedNode

from linked_fleet_agent.wire.schema import Schema
from linked_fleet_rdf.vocabulary import RDF

Kind = Literal["property", "action", "input", "feedback", "result", "event"]

_AS_IT_IS = re.compile(r"[A-Za-z0-9_]+", re.ASCII)
_XML_NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_.-]*\Z")
"""The end of a predicate that RDF/XML can say."""


class Place(Struct, frozen=True):
    """The schema of a value, its own term, and the predicate that links it: the own term or the ``@type``.

    ``members`` are the places in an object, ``items`` that of each item of an array.
    """

    schema: Schema
    term: NamedNode
    predicate: NamedNode
    members: "Mapping[str, Place]"
    items: "Place | None"

    @property
    def title(self) -> str:
        """Return the title, else the name."""
        return self.schema.title or self.name

    @property
    def name(self) -> str:
        """Return the name, which is the last part of the term, escaped."""
        return unescaped(self.term.value.rpartition("-")[2])

    @property
    def stands_for(self) -> NamedNode | None:
        """Return the ``@type`` if it does not link the value itself."""
        said = self.schema.semantic_type
        return NamedNode(said) if said != self.predicate.value and is_iri(said) else None


def vocabulary_iri(robot: str) -> str:
    """Return the IRI of the vocabulary of the robot with the IRI ``robot``, which ends in a slash."""
    return f"{robot}vocabulary"


def term_iri(robot: str, component: str, kind: Kind, name: str) -> str:
    """Return the own term of a part of a component."""
    return f"{vocabulary_iri(robot)}#{_escaped(component)}-{kind}-{_escaped(name)}"


def member_iri(term: str, name: str) -> str:
    """Return the own term of a member of the object that ``term`` links."""
    return f"{term}-{_escaped(name)}"


def place_of(schema: Schema, term: str, predicate: NamedNode | None = None) -> Place:
    """Return the place of a value with the own term ``term``, linked by it or by ``predicate``."""
    own = NamedNode(term)
    items = None if schema.items is None else place_of(schema.items, term)
    return Place(schema, own, predicate or own, _members(schema, term), items)


def _members(schema: Schema, term: str) -> dict[str, Place]:
    types = {name: member.semantic_type for name, member in schema.properties.items()}
    linked = linking_types(types, term)
    return {
        name: place_of(member, member_iri(term, name), linked.get(name)) for name, member in schema.properties.items()
    }


def linking_types(types: Mapping[str, str], term: str) -> dict[str, NamedNode]:
    """Return the ``@type`` of each member of one node that can link it, by name; ``term`` is any of the vocabulary."""
    counts = Counter(types.values())
    vocabulary = term.partition("#")[0] + "#"
    return {
        name: NamedNode(iri)
        for name, iri in types.items()
        if iri and counts[iri] == 1 and not iri.startswith((vocabulary, RDF.iri)) and _is_predicate(iri)
    }


def _is_predicate(iri: str) -> bool:
    return _XML_NAME.search(iri) is not None and is_iri(iri)


def is_iri(text: str) -> bool:
    """Return True for an IRI by RFC 3987, of which a declaration has only the outline checked."""
    try:
        NamedNode(text)
    except ValueError:
        return False
    return True


def _escaped(name: str) -> str:
    """Return letters, digits and ``_`` of a name as they are, and other bytes of its UTF-8 form as ``.XX``."""
    if _AS_IT_IS.fullmatch(name):
        return name
    return "".join(chr(byte) if _AS_IT_IS.fullmatch(chr(byte)) else f".{byte:02X}" for byte in name.encode())


def unescaped(segment: str) -> str:
    """Return the name of an escaped one."""
    head, *rest = segment.split(".")
    return (head.encode() + b"".join(bytes.fromhex(part[:2]) + part[2:].encode() for part in rest)).decode()
