"""Finds text that people should not have to read: bare IRIs, property names in camel case, e-notation."""

import re
from collections.abc import Iterator

from dom import Element

# Elements with text for programs: addresses to copy, queries, terms as in data, user input.
FOR_PROGRAMS = ("script", "style", "code", "pre", "textarea", "template")
_NAMES = ("WebSocket", "JavaScript", "JSON", "MuJoCo", "TIAGo", "GiB", "MiB")
_WRONG = {
    "a bare IRI": re.compile(r"https?://|\burn:"),
    "a prefixed name": re.compile(r"\b(?:lf|vom|maths|ros|hybrit|sh|xsd|prov|sosa|ldp|qudt):\w"),
    "camel case": re.compile(r"\b[a-z]+(?:[A-Z][a-z0-9]*)+\b|\b(?:[A-Z][a-z]+){2,}\b"),
    "a split dimension": re.compile(r"\b[a-z]+\d d\b"),
    "an id": re.compile(r"\b[0-9a-f]{8}-[0-9a-f]{4}-"),
    "e-notation": re.compile(r"(?<![\w-])\d+(?:\.\d+)?e[+-]?\d+\b"),
}


def texts(element: Element) -> Iterator[str]:
    """Yield the texts of a page that people read."""
    for each in element.children:
        if isinstance(each, str):
            if each.strip():
                yield each.strip()
        elif each.tag not in FOR_PROGRAMS:
            yield from texts(each)


def faults(text: str) -> list[str]:
    """Return the faults of a text that people read, each with the text."""
    said = re.sub("|".join(_NAMES), "", text)
    return [f"{name}: {text[:200]}" for name, wrong in _WRONG.items() if wrong.search(said)]


def for_programs(page: Element) -> list[str]:
    """Return each text that is fit for programs only, with its fault."""
    return [fault for text in texts(page) for fault in faults(text)]
