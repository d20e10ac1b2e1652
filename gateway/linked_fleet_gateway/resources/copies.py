"""Documents of one kind, which differ in the path of their owner and in values: one is rendered, the others are copies.

A fleet has thousands of blueprints of a few dozen kinds, and hundreds of actions that differ in limits. The document of
a kind is rendered with markers in place of path and values. A copy equals the rendered document byte for byte, because
only names and values take part that every text syntax writes as they are.
"""

import re
from collections.abc import Sequence

from pyoxigraph import Literal

from linked_fleet_gateway.rdf.graph import Graph
from linked_fleet_gateway.rdf.serialise import TEXT_TYPES
from linked_fleet_gateway.rdf.templates import Document, Markers, Template, is_replaceable, write_graph
from linked_fleet_gateway.rdf.vocabulary import PREFIXES
from linked_fleet_gateway.resources.resource import DescriptionTemplate, Resource

MAX_COPIES = 512
MAX_CHARACTERS = 8 * 1024 * 1024
"""Limit of the characters of all kinds. The oldest is dropped first."""
# Excludes characters that some syntax escapes, and segments that look like a prefix or a relative reference.
_PLAIN = re.compile(r"(/[A-Za-z0-9_~][A-Za-z0-9_~-]*)+/?", re.ASCII)
_Key = tuple[object, ...]


class Copies:
    """Cached texts by kind, datatypes of values, media type and base URL."""

    def __init__(self, max_templates: int = MAX_COPIES, max_characters: int = MAX_CHARACTERS) -> None:
        self._most, self._max_characters = max_templates, max_characters
        self._kept: dict[_Key, Template] = {}
        self._characters = 0

    def document(self, resource: Resource, media_type: str, base: str) -> Document | None:
        """Return the document; None if the resource has no kind or must be rendered. Raises WriteError."""
        kind = resource.template
        if kind is None or media_type not in TEXT_TYPES or not _PLAIN.fullmatch(kind.owner):
            return None
        values = kind.values()
        texts, datatypes = [], []
        for literal in values:
            text, datatype = literal.value, literal.datatype.value
            if literal.language is not None or not is_replaceable(text, datatype):
                return None
            texts.append(text)
            datatypes.append(datatype)
        key = (kind.key, kind.owner.endswith("/"), *datatypes, media_type, base)
        template = self._kept.get(key) or self._keep(key, _compile(resource, kind, values, media_type, base))
        texts.append(kind.owner.rstrip("/")[1:])
        return Document(template.fill(texts), template, texts)

    def _keep(self, key: _Key, template: Template) -> Template:
        self._kept[key] = template
        self._characters += template.characters
        while len(self._kept) > self._most or (self._characters > self._max_characters and len(self._kept) > 1):
            self._characters -= self._kept.pop(next(iter(self._kept))).characters
        return template


def _compile(
    resource: Resource, kind: DescriptionTemplate, values: Sequence[Literal], media_type: str, base: str
) -> Template:
    """Return the text of one resource of the kind, with places for its values and for the path of its owner."""
    marks = Markers()
    owner = "/" + marks.text(len(values))
    path = owner + resource.path[len(kind.owner.rstrip("/")) :]
    graph = Graph()
    marked = [marks.literal(index, literal) for index, literal in enumerate(values)]
    kind.describe(graph, owner + ("/" if kind.owner.endswith("/") else ""), marked)
    resource.add_interaction_model(graph, base, path)
    return marks.template(write_graph(graph, media_type, PREFIXES, base=base + path).decode())
