"""Templates of documents: the text between places, and for each place the value that belongs there.

A description is written once with markers in place of values and names. The positions of the markers are the places. So
a template cannot state anything that its description does not. Only values and names take part that every text syntax
writes as they are.
"""

import re
import secrets
from collections.abc import Sequence
from threading import Lock
from typing import NamedTuple

from pyoxigraph import Literal, NamedNode

from linked_fleet_rdf.vocabulary import XSD

_TEXT = re.compile(r"[A-Za-z0-9 _.,:;()/+=*@-]+", re.ASCII)
_INTEGER = re.compile(r"0|-?[1-9][0-9]{0,14}", re.ASCII)
_FRACTION = re.compile(r"-?[0-9]+\.[0-9]+", re.ASCII)
_EXPONENT = re.compile("[eE]")
_STRING, _FLOAT, _DOUBLE, _TIME, _WHOLE, _DECIMAL = (
    each.value for each in (XSD.string, XSD.float, XSD.double, XSD.dateTime, XSD.integer, XSD.decimal)
)
Key = tuple[object, ...]


class Template:
    """The text between places, and for each place the index of the value that belongs there."""

    __slots__ = ("__weakref__", "_places", "_texts", "characters")

    def __init__(self, texts: Sequence[str], places: Sequence[int]) -> None:
        """``texts``: one more than places."""
        self._texts = [""] * (2 * len(places) + 1)
        self._texts[::2] = texts
        self._places = tuple(places)
        self.characters = sum(map(len, texts))
        """Number of characters of its text."""

    @property
    def texts(self) -> list[str]:
        return self._texts[::2]

    @property
    def places(self) -> tuple[int, ...]:
        return self._places

    def fill(self, values: Sequence[str]) -> bytes:
        # Joining takes a quarter of the time of the operator %, which parses the text.
        texts = self._texts.copy()
        texts[1::2] = [values[place] for place in self._places]
        return "".join(texts).encode()


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


class Document(NamedTuple):
    """The bytes of a document, and if a template was filled in, that template and the values."""

    content: bytes
    template: Template | None = None
    values: Sequence[str] = ()
    """They contain no NUL."""


class TemplateCache:
    """Templates by key, of ``max_templates`` and ``max_characters`` at most; the oldest is dropped first.

    A key may have None instead: its documents have no template. Safe for threads.
    """

    def __init__(self, max_templates: int, max_characters: int) -> None:
        self._most, self._max_characters = max_templates, max_characters
        self._kept: dict[Key, Template | None] = {}
        self._characters = 0
        self._changing = Lock()

    def __len__(self) -> int:
        return len(self._kept)

    @property
    def characters(self) -> int:
        """Number of characters of all templates."""
        return self._characters

    def __contains__(self, key: Key) -> bool:
        return key in self._kept

    def get(self, key: Key) -> Template | None:
        return self._kept.get(key)

    def keep(self, key: Key, template: Template | None) -> None:
        with self._changing:
            self._characters += _characters(template) - _characters(self._kept.get(key))
            self._kept[key] = template
            while len(self._kept) > self._most or (self._characters > self._max_characters and len(self._kept) > 1):
                self._characters -= _characters(self._kept.pop(next(iter(self._kept))))


def _characters(template: Template | None) -> int:
    return 0 if template is None else template.characters


class Markers:
    """Markers for values and names in one document: each ends with an index, and nothing else can equal it."""

    def __init__(self) -> None:
        self._word = f"m{secrets.token_hex(8)}"
        self._kinds = {_WHOLE: f"9{secrets.randbelow(10**8):08}", _DECIMAL: f"8{secrets.randbelow(10**8):08}."}
        words = "|".join(map(re.escape, (self._word, *self._kinds.values())))
        self._pattern = re.compile(f"(?:{words})([0-9]{{6}})", re.ASCII)

    def text(self, index: int) -> str:
        """Return the marker in place of a text or a name."""
        return f"{self._word}{index:06}"

    def literal(self, index: int, datatype: NamedNode) -> Literal:
        """Return the marker in place of a literal for which ``is_replaceable`` is true."""
        return Literal(f"{self._kinds.get(datatype.value, self._word)}{index:06}", datatype=datatype)

    def template(self, document: str) -> Template:
        """Return the document with places where it has markers."""
        pieces = self._pattern.split(document)
        return Template(pieces[::2], tuple(map(int, pieces[1::2])))


def is_replaceable(text: str, datatype: str) -> bool:
    """Return True if all texts of this kind are written alike, in each syntax."""
    if datatype == _WHOLE:
        return _INTEGER.fullmatch(text) is not None
    if datatype == _DECIMAL:
        return _FRACTION.fullmatch(text) is not None
    if datatype == _DOUBLE and _EXPONENT.search(text):  # Turtle writes those without quotes
        return False
    return datatype in (_STRING, _FLOAT, _DOUBLE, _TIME) and _TEXT.fullmatch(text) is not None
