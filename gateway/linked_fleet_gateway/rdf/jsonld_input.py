"""Checks of the context of a JSON-LD document from a client, before it is expanded.

A parser processes a scoped or nested context again at every use, so a few kilobytes could take minutes. A single flat
context at the top of the document is processed once.
"""

import json
from collections.abc import Mapping
from typing import Any
from urllib.parse import urljoin

from linked_fleet_gateway.rdf.json_input import load_json
from linked_fleet_gateway.rdf.parse_error import ParseError

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
