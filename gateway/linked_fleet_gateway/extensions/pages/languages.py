"""Languages of pages: English messages, their translations, and the language of the page that is being written.

A message is its own key: an English sentence, with ``{name}`` for each value in it. The folder ``languages`` of an
extension has a file for each other language, such as ``de.json``, which maps messages to translations. The language of
a page is set while the page is written, so that functions deep in a view need not pass it on.
"""

import json
import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field
from pathlib import Path
from urllib.parse import quote

from markupsafe import Markup, escape

from linked_fleet_base.contributions import present

ENGLISH = "en"
MARKED = "en-XA"
"""A language for tests and authors of extensions: English in which each message of a catalogue stands in marks."""
NAMES = {ENGLISH: "English", "de": "Deutsch"}
"""The languages of the switch, each by its own name."""
_WITH_COMMA = frozenset({"de"})
COOKIE = "language"
"""The cookie that has the chosen language. It says nothing about a person, and scripts may read it."""
SEGMENT = "~language"
"""The segment below ``/`` of the links that set the cookie: no robot can have this name."""
_MARKS = "⟦{}⟧"
_SLOT = re.compile(r"\{(\w+)\}")
_RANGE = re.compile(
    r"\s*([A-Za-z]{1,8}(?:-[A-Za-z0-9]{1,8})*|\*)\s*(?:;\s*q\s*=\s*(0(?:\.\d{0,3})?|1(?:\.0{0,3})?))?\s*"
)
_MOST_RANGES = 32
_FOLDER = Path(__file__).parent / "languages"

_language: ContextVar[str] = ContextVar("language", default=ENGLISH)


@dataclass
class _Catalogues:
    """The translations by message, by language."""

    by_language: dict[str, dict[str, str]] = field(default_factory=dict)


def _catalogues() -> dict[str, dict[str, str]]:
    return present().derived("translations", _with_own).by_language


def _with_own() -> _Catalogues:
    found = _Catalogues()
    _read(_FOLDER, found.by_language)
    return found


def add_folder(folder: Path) -> None:
    """Add the translations of an extension. Raises OSError, ValueError for a file that is no catalogue."""
    _read(folder, _catalogues())


def _read(folder: Path, into: dict[str, dict[str, str]]) -> None:
    for path in sorted(folder.glob("*.json")):
        read = json.loads(path.read_text(encoding="utf-8"))
        if not isinstance(read, dict) or not all(isinstance(each, str) for each in read.values()):
            raise ValueError(f"{path} is no JSON object with a text for each message")
        into.setdefault(path.stem, {}).update(read)


def translations(language: str) -> Mapping[str, str]:
    return _catalogues().get(language, {})


def chosen_language(preferred: str) -> str:
    """Return the language of pages that fits a value of Accept-Language (RFC 9110, 12.5.4) best; else English."""
    ranges = []
    for place, each in enumerate(preferred.split(",", _MOST_RANGES)[:_MOST_RANGES]):
        if found := _RANGE.fullmatch(each):
            ranges.append((-float(found[2] or 1), place, found[1].lower()))
    for weight, _, tag in sorted(ranges):
        if weight < 0 and (language := _spoken(tag)):
            return language
    return ENGLISH


def _spoken(tag: str) -> str:
    if tag == MARKED.lower():
        return MARKED
    primary = tag.partition("-")[0]
    return primary if primary in NAMES else ""


def address_of_choice(language: str, then: str) -> str:
    """Return the path of the link that chooses a language; ``then`` is the path of the page to which it leads back."""
    return f"/{SEGMENT}/{language}?then={quote(then, safe='/')}"


def language() -> str:
    """Return the language of the page that is being written."""
    return _language.get()


@contextmanager
def speaking(preferred: str) -> Iterator[str]:
    """Write pages in the language that fits ``preferred``, a value of Accept-Language, best."""
    spoken = chosen_language(preferred) if preferred else ENGLISH
    token = _language.set(spoken)
    try:
        yield spoken
    finally:
        _language.reset(token)


def message(text: str) -> str:
    """Return a text as it is: this marks a message that is translated where it is shown."""
    return text


def say(message: str, **values: object) -> str:
    """Return a message in the language of the page, with ``values`` in the places of their names."""
    said = translated(message)
    return _SLOT.sub(lambda found: str(values.get(found[1], found[0])), said) if values else said


def translated(message: str) -> str:
    """Return the translation of a message; the message itself without one."""
    spoken = _language.get()
    if spoken == ENGLISH or not message:
        return message
    if spoken == MARKED:
        return _MARKS.format(message)
    return _catalogues().get(spoken, {}).get(message) or message


def localized(number: str) -> str:
    """Return a number as people write it in the language of the page."""
    return number.replace(".", ",") if _language.get() in _WITH_COMMA else number


def known(text: str) -> str:
    """Return the translation of a text that may be a message, such as a title; the text itself for any other."""
    spoken = _language.get()
    if spoken == ENGLISH:
        return text
    if spoken == MARKED:
        return _MARKS.format(text) if any(text in each for each in _catalogues().values()) else text
    return _catalogues().get(spoken, {}).get(text) or text


def said_in_template(message: str, values: list[object]) -> Markup:
    """Return a message of a template, in which ``{1}`` is the first of ``values``."""

    def value(found: re.Match[str]) -> str:
        at = int(found[1]) if found[1].isdigit() else 0
        return str(escape(values[at - 1])) if 0 < at <= len(values) else found[0]

    return Markup(_SLOT.sub(value, str(escape(translated(message)))))  # noqa: S704 - the values are escaped
