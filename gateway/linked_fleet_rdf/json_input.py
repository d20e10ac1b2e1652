"""JSON and JSON-LD from clients, checked before anything parses or expands it; the errors of all parsers.

Of two members with one name ``json`` keeps the last, other parsers the first. A lone surrogate is a Python string that
no encoder accepts. Both are refused here, for plain JSON and for JSON-LD alike.

A parser processes a scoped or nested context again at every use, so a few kilobytes could take minutes. A single flat
context at the top of the document is processed once.
"""

import json
import re
from collections.abc import Callable, Mapping
from itertools import chain
from typing import Any
from urllib.parse import urljoin


class ParseError(Exception):
    """A refused document. ``line`` and ``column`` count from 1; None if the syntax does not give them."""

    def __init__(self, message: str, line: int | None = None, column: int | None = None) -> None:
        super().__init__(message)
        self.message, self.line, self.column = message, line, column


class InputTooLargeError(ParseError):
    """A document with more triples than the limit."""


# Matches the text up to the first escape of a lone surrogate. Possessive quantifiers keep it to one pass.
_PAIRED = re.compile(
    r"(?:[^\\]++|\\u[dD][89abAB][0-9a-fA-F]{2}\\u[dD][c-fC-F][0-9a-fA-F]{2}|\\u(?![dD][89a-fA-F])|\\[^u])*+"
)


def load_json(text: str, max_depth: int, max_values: int, number: Callable[[str], Any] | None = None) -> Any:
    """Parse a document, with numbers converted by ``number``. Raises ParseError."""
    # A cheap upper bound of the number of values; characters within strings count too.
    if text.count(",") + text.count("[") + text.count("{") > max_values:
        raise ParseError(f"JSON has more than {max_values} commas and opening brackets")
    try:
        document = json.loads(
            text,
            parse_int=number,
            parse_float=number,
            parse_constant=_refuse_constant,
            object_pairs_hook=_unique_members,
        )
    except RecursionError as error:
        raise _too_deep(max_depth) from error
    except json.JSONDecodeError as error:
        raise ParseError(error.msg, error.lineno, error.colno) from error
    except ValueError as error:  # an integer with more digits than Python converts
        raise ParseError(f"unacceptable JSON: {error}") from error
    _check_depth(document, max_depth)
    _refuse_lone_surrogates(text)
    return document


def _check_depth(document: Any, max_depth: int) -> None:
    """Count the levels of objects and arrays, one level at a time."""
    level, depth = [document], 0
    while level := [each for each in level if type(each) in (dict, list)]:
        depth += 1
        if depth > max_depth:
            raise _too_deep(max_depth)
        level = list(chain.from_iterable(each.values() if type(each) is dict else each for each in level))


def _too_deep(max_depth: int) -> ParseError:
    return ParseError(f"JSON is nested more than {max_depth} deep")


def _refuse_lone_surrogates(text: str) -> None:
    if "\\u" not in text:
        return
    match = _PAIRED.match(text)
    at = match.end() if match is not None else 0
    if at < len(text):
        line, column = text.count("\n", 0, at) + 1, at - text.rfind("\n", 0, at)
        escape = text[at : at + 6]
        raise ParseError(f"{escape} is half of a surrogate pair, which no text can hold", line, column)


def _unique_members(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    members = dict(pairs)
    if len(members) != len(pairs):
        raise ParseError("an object has two members of the same name")
    return members


def _refuse_constant(name: str) -> float:
    raise ParseError(f"{name} is not JSON")


MAX_TERMS = 100
MAX_TERM_CHARACTERS = 256
# Each use of a term repeats the expansion of its chain of prefixes, so the sum of all definitions is bounded.
MAX_CONTEXT_CHARACTERS = 8192
_CONTEXT = "@context"
_OF_CONTEXT = ("@base", "@direction", "@language", "@protected", "@version", "@vocab")
_OF_TERM = ("@container", "@direction", "@id", "@index", "@language", "@nest", "@prefix", "@protected", "@reverse",
            "@type")  # fmt: skip


def check_jsonld(text: str, base: str, contexts: Mapping[str, dict[str, Any]], max_depth: int, max_values: int) -> str:
    """Return the document with known contexts inlined. Raises ParseError for a context that is not accepted."""
    document = load_json(text, max_depth, max_values)
    top = document[0] if isinstance(document, list) and len(document) == 1 else document
    _refuse_nested(top, contexts)
    if not isinstance(top, dict) or not isinstance(context := top.get(_CONTEXT), str | list | dict):
        return text
    if isinstance(context, dict):
        _check_inline(context, contexts)
        return text  # unchanged, so that the parser reports positions in the client's text
    merged = _merged(context if isinstance(context, list) else [context], base, contexts)
    try:
        return json.dumps({**top, _CONTEXT: merged}, allow_nan=False)
    except ValueError as error:  # a number outside the range of float
        raise ParseError(f"unacceptable JSON: {error}") from error


def _accepted(contexts: Mapping[str, dict[str, Any]]) -> str:
    known = " or ".join(f"<{each}>" for each in contexts) or "none by reference"
    return f"accepted is one @context at the top of the document: {known}, or one object of terms, each at most once"


def _refuse_nested(top: Any, contexts: Mapping[str, dict[str, Any]]) -> None:
    """Refuse every ``@context`` except that of the top object."""
    level: list[Any] = list(top.values()) if isinstance(top, dict) else [top]
    if isinstance(top, dict) and _CONTEXT in top:
        level = [value for name, value in top.items() if name != _CONTEXT]
    while level:
        below: list[Any] = []
        for each in level:
            if type(each) is dict:
                if _CONTEXT in each:
                    raise ParseError(f"a nested @context is not accepted; {_accepted(contexts)}")
                below.extend(each.values())
            elif type(each) is list:
                below.extend(each)
        level = below


def _merged(written: list[Any], base: str, contexts: Mapping[str, dict[str, Any]]) -> dict[str, Any]:
    """Merge at most one known context and one inline context, which takes precedence."""
    merged: dict[str, Any] = {}
    kinds = [type(each) for each in written]
    if any(kind not in (str, dict) for kind in kinds) or len(set(kinds)) != len(kinds):
        raise ParseError(f"repeated contexts are not accepted; {_accepted(contexts)}")
    for each in written:
        if isinstance(each, str):
            merged |= _known(each, base, contexts)
        else:
            _check_inline(each, contexts)
            merged |= each
    return merged


def _known(reference: str, base: str, contexts: Mapping[str, dict[str, Any]]) -> dict[str, Any]:
    try:
        known = contexts.get(reference) or contexts.get(urljoin(base, reference))
    except ValueError as error:
        raise ParseError(f"{reference[:200]!r} is no IRI") from error
    if known is None:
        raise ParseError(f"remote contexts are never fetched ({reference[:200]}); {_accepted(contexts)}")
    context: dict[str, Any] = known.get(_CONTEXT, known)
    return context


def _check_inline(context: Mapping[str, Any], contexts: Mapping[str, dict[str, Any]]) -> None:
    if len(context) > MAX_TERMS:
        raise ParseError(f"the @context has {len(context)} terms, at most {MAX_TERMS} are accepted")
    characters = 0
    for term, definition in context.items():
        if term == "@import":
            raise ParseError(f"@import names a remote context, and none is fetched; {_accepted(contexts)}")
        if term.startswith("@") and term not in _OF_CONTEXT:
            raise ParseError(f"{term[:50]} in a @context is not accepted; {', '.join(_OF_CONTEXT)} and terms are")
        characters += len(term) + _check_definition(term, definition, contexts)
    if characters > MAX_CONTEXT_CHARACTERS:
        raise ParseError(f"the @context has {characters} characters, at most {MAX_CONTEXT_CHARACTERS} are accepted")


def _check_definition(term: str, definition: Any, contexts: Mapping[str, dict[str, Any]]) -> int:
    """Return the number of characters in a definition of plain values. Raises ParseError for a scoped context."""
    members = definition if isinstance(definition, dict) else {"@id": definition}
    if _CONTEXT in members or _CONTEXT in members.values():
        raise ParseError(f"a scoped @context ({term[:50]}) is not accepted; {_accepted(contexts)}")
    if strange := [name for name in members if name not in _OF_TERM]:
        raise ParseError(f"{strange[0][:50]} in the definition of a term is not accepted; {', '.join(_OF_TERM)} are")
    if isinstance(definition, dict) and isinstance(members.get("@container"), list):
        members = {**members, "@container": " ".join(map(str, members["@container"]))[: MAX_TERM_CHARACTERS + 1]}
    if any(isinstance(value, dict | list) for value in members.values()):
        raise ParseError(f"the definition of {term[:50]!r} has a value that is no text")
    characters = sum(len(value) for value in members.values() if isinstance(value, str))
    if max(characters, len(term)) > MAX_TERM_CHARACTERS:
        raise ParseError(f"the definition of {term[:50]!r} has more than {MAX_TERM_CHARACTERS} characters")
    return characters
