"""Finds what people do not read: bare IRIs, property names in camel case, e-notation."""

import re
from collections.abc import Iterator

from dom import Element

# Here stands what is for programs: addresses to copy, queries, terms as data has them, what somebody typed.
_FOR_PROGRAMS = ("script", "style", "code", "pre", "textarea", "template")
_NAMES = ("WebSocket", "JavaScript", "JSON", "MuJoCo", "TIAGo", "GiB", "MiB")
_WRONG = {
    "a bare IRI": re.compile(r"https?://|\burn:"),
    "a prefixed name": re.compile(r"\b(?:lf|vom|maths|ros|hybrit|sh|xsd|prov|sosa|ldp|qudt):\w"),
    "camel case": re.compile(r"\b[a-z]+(?:[A-Z][a-z0-9]*)+\b|\b(?:[A-Z][a-z]+){2,}\b"),
    "a split dimension": re.compile(r"\b[a-z]+\d d\b"),
    "e-notation": re.compile(r"(?<![\w-])\d+(?:\.\d+)?e[+-]?\d+\b"),
}


def texts(element: Element) -> Iterator[str]:
    """Texts of a page that people read."""
    for each in element.children:
        if isinstance(each, str):
            if each.strip():
                yield each.strip()
        elif each.tag not in _FOR_PROGRAMS:
            yield from texts(each)


def for_programs(page: Element) -> list[str]:
    """Each text of a page that people should not have to read, with what is wrong with it."""
    found = []
    for text in texts(page):
        said = re.sub("|".join(_NAMES), "", text)
        found += [f"{name}: {text[:200]}" for name, wrong in _WRONG.items() if wrong.search(said)]
    return found
