"""Documents of one kind, which differ in the path of their owner and in values: one is rendered, the others are copies.

A fleet has thousands of blueprints of a few dozen kinds, and hundreds of actions that differ in limits. The document of
a kind is rendered with markers in place of path and values. A copy equals the rendered document byte for byte, because
only names and values take part that every text syntax writes as they are. Rows of values, such as the samples of a
history, are repeated: their text is that between the second and the third row.
"""

import re
from collections.abc import Sequence
from threading import Lock

from pyoxigraph import Literal

from linked_fleet_gateway.rdf.graph import Graph
from linked_fleet_gateway.rdf.serialise import TEXT_TYPES
from linked_fleet_gateway.rdf.templates import Document, Markers, Template, is_replaceable, write_graph
from linked_fleet_gateway.rdf.vocabulary import PREFIXES
from linked_fleet_gateway.resources.resource import DescriptionTemplate, Resource, Rows

MAX_COPIES = 512
MAX_CHARACTERS = 8 * 1024 * 1024
"""Limit of the characters of all kinds. The oldest is dropped first."""
# Excludes characters that some syntax escapes, and segments that look like a prefix or a relative reference.
_PLAIN = re.compile(r"(/[A-Za-z0-9_~][A-Za-z0-9_~-]*)+/?", re.ASCII)
_Key = tuple[object, ...]
_REPEATED = 3
"""Documents with so many rows or more differ in their number alone."""


class Copies:
    """Cached texts by kind, datatypes of values, media type and base URL."""

    def __init__(self, max_templates: int = MAX_COPIES, max_characters: int = MAX_CHARACTERS) -> None:
        self._most, self._max_characters = max_templates, max_characters
        self._kept: dict[_Key, Template | None] = {}
        """None for a kind whose rows are not written alike."""
        self._characters = 0
        self._changing = Lock()

    def document(self, resource: Resource, media_type: str, base: str) -> Document | None:
        """Return the document; None if the resource has no kind or must be rendered. Raises WriteError."""
        kind, found = resource.template, _values(resource.template, media_type, base)
        if kind is None or found is None:
            return None
        key, texts = found
        if key not in self._kept:
            self._keep(key, _compile(resource, kind, kind.values(), media_type, base))
        template = self._kept.get(key)
        if template is None:
            return None
        texts += _segments(kind.owner)
        if kind.rows is not None:
            texts += kind.rows.texts
        return Document(template.fill(texts), template, texts)

    def is_known(self, resource: Resource, media_type: str, base: str) -> bool:
        """Return True if the text of the resource's kind is cached, so that its document takes little time."""
        found = _values(resource.template, media_type, base)
        return found is not None and self._kept.get(found[0]) is not None

    def _keep(self, key: _Key, template: Template | None) -> None:
        with self._changing:
            self._kept[key] = template
            self._characters += 0 if template is None else template.characters
            while len(self._kept) > self._most or (self._characters > self._max_characters and len(self._kept) > 1):
                dropped = self._kept.pop(next(iter(self._kept)))
                self._characters -= 0 if dropped is None else dropped.characters


def _values(kind: DescriptionTemplate | None, media_type: str, base: str) -> tuple[_Key, list[str]] | None:
    """Return the key of the text and the values; None if a name or a value must be rendered."""
    if kind is None or media_type not in TEXT_TYPES or not _PLAIN.fullmatch(kind.owner):
        return None
    texts, datatypes = [], []
    for literal in kind.values():
        text, datatype = literal.value, literal.datatype.value
        if literal.language is not None or not is_replaceable(text, datatype):
            return None
        texts.append(text)
        datatypes.append(datatype)
    rows = None if kind.rows is None else (kind.rows.datatypes, min(_count(kind.rows), _REPEATED))
    owner = len(_segments(kind.owner)), kind.owner.endswith("/")
    return (kind.key, owner, rows, *datatypes, media_type, base), texts


def _segments(owner: str) -> list[str]:
    return owner.strip("/").split("/")


def _count(rows: Rows) -> int:
    return len(rows.texts) // len(rows.datatypes)


class RowTemplate(Template):
    """A template whose last values are rows of ``width`` values. It has any number of rows, one or more."""

    __slots__ = ("_between", "_first", "_head", "_order", "_tail", "_width")

    def __init__(self, whole: Template, first: int, width: int) -> None:
        """``first``: index of the first value of rows. Raises ValueError if the rows are not written alike."""
        texts, places = whole.texts, whole.places
        begin = next(at for at, place in enumerate(places) if place >= first)
        end = begin + sum(place >= first for place in places)
        super().__init__(texts, places)
        self._first, self._width = first, width
        rows = range(begin, end, width)
        orders = {tuple(place - first - at + begin for place in places[at : at + width]) for at in rows}
        inner = {tuple(texts[at + 1 : at + width]) for at in rows}
        outer = {texts[at] for at in rows[1:]}
        if len(orders) != 1 or len(inner) != 1 or len(outer) != 1 or sorted(*orders) != list(range(width)):
            raise ValueError("The rows are not written alike.")
        (self._order,), self._between = orders, [*inner.pop(), *outer]
        self._head, self._tail = Template(texts[: begin + 1], places[:begin]), Template(texts[end:], places[end:])

    def has_same_text(self, other: "RowTemplate") -> bool:
        """Return True if both differ in nothing but the number of rows they were made of."""
        ours, theirs = ((each._order, each._between, each._head, each._tail) for each in (self, other))
        return ours[:2] == theirs[:2] and all(
            one.texts == two.texts and one.places == two.places for one, two in zip(ours[2:], theirs[2:], strict=True)
        )

    def fill(self, values: Sequence[str]) -> bytes:
        rows, width = list(values[self._first :]), self._width
        for place, index in enumerate(self._order):
            if place != index:
                rows[place::width] = values[self._first + index :: width]
        parts = [""] * (2 * len(rows) - 1)
        parts[::2] = rows
        parts[1::2] = (self._between * (len(rows) // width))[:-1]
        return b"%b%b%b" % (self._head.fill(values), "".join(parts).encode(), self._tail.fill(values))


def _compile(
    resource: Resource, kind: DescriptionTemplate, values: Sequence[Literal], media_type: str, base: str
) -> Template | None:
    """Return the text of one resource of the kind, with places for values, names of its owner, and rows.

    Returns None if the rows of such documents are not written alike.
    """
    rows = kind.rows
    if rows is None or _count(rows) < _REPEATED:
        return _marked(resource, kind, values, media_type, base, 0 if rows is None else _count(rows))
    first, width = len(values) + len(_segments(kind.owner)), len(rows.datatypes)
    try:
        found, more = (
            RowTemplate(_marked(resource, kind, values, media_type, base, count), first, width)
            for count in (_REPEATED, _REPEATED + 1)
        )
    except ValueError:
        return None
    return found if found.has_same_text(more) else None


def _marked(
    resource: Resource, kind: DescriptionTemplate, values: Sequence[Literal], media_type: str, base: str, rows: int
) -> Template:
    """Return the text with places for so many rows."""
    marks = Markers()
    names = range(len(values), len(values) + len(_segments(kind.owner)))
    owner = "/" + "/".join(map(marks.text, names))
    path = owner + resource.path[len(kind.owner.rstrip("/")) :]
    graph = Graph()
    datatypes = () if kind.rows is None else kind.rows.datatypes * rows
    marked = [marks.literal(index, literal) for index, literal in enumerate(values)]
    marked += [marks.literal(at, Literal("", datatype=each)) for at, each in enumerate(datatypes, names.stop)]
    kind.describe(graph, owner + ("/" if kind.owner.endswith("/") else ""), marked)
    resource.add_interaction_model(graph, base, path)
    return marks.template(write_graph(graph, media_type, PREFIXES, base=base + path).decode())
