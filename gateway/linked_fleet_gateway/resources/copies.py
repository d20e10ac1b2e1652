"""Copies of documents of resources that differ only in their path: the first is rendered, the others are copied.

A fleet has thousands of blueprints of a few dozen kinds. A copy equals the rendered document byte for byte, because
names of things are written unescaped in every text syntax.
"""

import re
import secrets

from linked_fleet_gateway.rdf.graph import Graph
from linked_fleet_gateway.rdf.serialise import TEXT_TYPES, render
from linked_fleet_gateway.rdf.vocabulary import PREFIXES
from linked_fleet_gateway.resources.resource import Alike, Resource

MAX_KEPT = 512
# Excludes characters that some syntax escapes, and segments that look like a prefix or a relative reference.
_PLAIN = re.compile(r"(/[A-Za-z0-9_~][A-Za-z0-9_~-]*)+/?", re.ASCII)


class Copies:
    """Cached texts by kind, media type and base URL. The oldest is dropped first."""

    def __init__(self, most: int = MAX_KEPT) -> None:
        self._most = most
        self._kept: dict[tuple[object, str, str], list[str]] = {}

    def body(self, resource: Resource, media_type: str, base: str) -> bytes | None:
        """Return the document; None if the resource has no kind or must be rendered. Raises WriteError."""
        alike = resource.alike
        if alike is None or media_type not in TEXT_TYPES or not _PLAIN.fullmatch(alike.owner):
            return None
        key = (alike.key, media_type, base)
        pieces = self._kept.get(key)
        if pieces is None:
            pieces = self._kept[key] = _pieces(resource, alike, media_type, base)
            if len(self._kept) > self._most:
                del self._kept[next(iter(self._kept))]
        return alike.owner.rstrip("/").join(pieces).encode()


def _pieces(resource: Resource, alike: Alike, media_type: str, base: str) -> list[str]:
    """Return the text of one resource of the kind, split at the path of its owner."""
    mark = f"/x{secrets.token_hex(8)}"
    slash = "/" if alike.owner.endswith("/") else ""
    path = mark + resource.path[len(alike.owner.rstrip("/")) :]
    graph = Graph()
    alike.describe(graph, mark + slash)
    resource.state_model(graph, base, path)
    return render(graph.triples, media_type, PREFIXES, base=base + path).decode().split(mark)
