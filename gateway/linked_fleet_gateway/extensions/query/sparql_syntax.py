"""Lexical checks of a query before it is parsed (SPARQL 1.1 Query Language, 19).

Queries are parsed and evaluated in a worker process, because some take the parser or planner a minute or overflow its
stack. This one pass over tokens finds the query form, its dataset and its variables.
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from urllib.parse import urljoin

from linked_fleet_base.errors import BadRequest, PayloadTooLarge
from linked_fleet_rdf.sparql_tokens import Token, syntax_error, tokenize
from linked_fleet_rdf.vocabulary import PREFIXES

MAX_DECLARATIONS = 256
"""Most BASE, PREFIX and FROM in one query: each is resolved against the previous one."""
MAX_IRI = 2048
FORMS = ("SELECT", "ASK", "CONSTRUCT", "DESCRIBE")
_UPDATES = frozenset({"INSERT", "DELETE", "LOAD", "CLEAR", "CREATE", "DROP", "COPY", "MOVE", "ADD", "WITH"})


@dataclass(frozen=True)
class Dataset:
    """IRIs of the graphs of a query (SPARQL 1.1, 13.2); if both are None, the query is over all graphs."""

    default: tuple[str, ...] | None = None
    named: tuple[str, ...] | None = None

    @classmethod
    def from_iris(cls, default: tuple[str, ...], named: tuple[str, ...]) -> "Dataset":
        """Return the dataset; if either part is given, the other is empty."""
        return cls(default, named) if default or named else cls()


@dataclass(frozen=True)
class Query:
    """A query that may be evaluated: text, form (one of ``FORMS``) and dataset."""

    text: str
    form: str
    dataset: Dataset
    words: frozenset[str]
    """Local parts of the names and IRIs in the query, which tell the functions that it can call."""


def parse_query(text: str, base: str) -> Query:
    """Check a query and return it. Raises PayloadTooLarge or BadRequest. ``base`` resolves relative IRIs."""
    tokens = tokenize(text)
    first = next((each.word for each in tokens if each.word not in ("", "PREFIX", "BASE", "VERSION")), "")
    if first in _UPDATES:
        raise BadRequest(f"{first} is an update; this endpoint reads. What moves robots are their actions.")
    if first not in FORMS:
        raise BadRequest(f"A query is one of {', '.join(FORMS)}.")
    for each in tokens:
        if each.word == "SERVICE":
            raise syntax_error("SERVICE is not evaluated: the fleet asks nobody else. Ask both, and join.", text, each)
    _check_prefixes(text, tokens, base)
    names = (re.split(r"[:/#]", each.text.strip("<>"))[-1] for each in tokens if each.kind in ("iri", "name"))
    return Query(text, first, _dataset(text, tokens, base), frozenset(names))


def check_select(query: str) -> list[str]:
    """Return the variables of a SELECT query in order, without question marks. Raises BadRequest, PayloadTooLarge.

    Variables must be named, because ``*`` is resolved only by the parser. ``Queries.check`` finds other syntax errors
    in a worker process.
    """
    found = parse_query(query, "http://localhost/")
    if found.form != "SELECT":
        raise BadRequest(f"This takes a SELECT query, not {found.form}.")
    tokens = tokenize(query)
    after = next(index for index, each in enumerate(tokens) if each.word == "SELECT") + 1
    variables = list(_projected(tokens[after:]))
    if not variables:
        raise BadRequest("Name the variables that the query selects, as in SELECT ?robot ?joint.")
    if len(set(variables)) != len(variables):
        raise BadRequest("The query selects a variable twice.")
    return variables


def bound_iris(query: str, variable: str, base: str) -> list[str]:
    """Return the IRIs that a query binds to a variable by ``<iri> AS ?variable`` or VALUES; ``base`` resolves relative
    IRIs.

    Bindings by patterns or functions are known only after evaluation.
    """
    tokens = tokenize(query)
    base, prefixes = _declared(tokens, base)
    found = []
    for each, after, to in zip(tokens, tokens[1:], tokens[2:], strict=False):
        bound = after.word == "AS" and to.kind == "variable" and to.text[1:] == variable
        if bound and each.kind in ("iri", "name"):
            found.append(each)
    for index, each in enumerate(tokens):
        if each.word == "VALUES":
            found += _listed(tokens[index + 1 :], variable)
    return [_iri(query, each, prefixes, base) for each in found]


def _listed(tokens: list[Token], variable: str) -> Iterator[Token]:
    """Yield the IRIs for the variable in the data block at the start of ``tokens``."""
    start = next((index for index, each in enumerate(tokens) if each.text == "{"), len(tokens))
    names = [each.text[1:] for each in tokens[:start] if each.kind == "variable"]
    column = 0
    for before, each in zip(tokens[start:], tokens[start + 1 :], strict=False):
        if each.text == "}":
            return
        if each.kind in ("open", "close") or before.text == "^":  # a datatype is no term of its own
            column = 0 if each.kind == "open" else column
        elif each.kind in ("iri", "name", "string", "number", "word"):
            if names and names[column % len(names)] == variable and each.kind in ("iri", "name"):
                yield each
            column += 1


def _projected(tokens: list[Token]) -> Iterator[str]:
    """Yield the selected variables and aliases up to the start of the pattern or dataset."""
    depth = 0
    for index, each in enumerate(tokens):
        if depth == 0 and (each.word in ("WHERE", "FROM") or each.text == "{"):
            return
        depth += (each.kind == "open") - (each.kind == "close")
        named = depth == 1 and index > 0 and tokens[index - 1].word == "AS"
        if each.kind == "variable" and (depth == 0 or named):
            yield each.text[1:]


def _dataset(text: str, tokens: list[Token], base: str) -> Dataset:
    base, prefixes = _declared(tokens, base)
    default: list[str] = []
    named: list[str] = []
    for index, each in enumerate(tokens):
        rest = tokens[index + 1 : index + 3]
        if each.word == "FROM" and rest:
            into, term = (named, rest[-1]) if rest[0].word == "NAMED" else (default, rest[0])
            into.append(_iri(text, term, prefixes, base))
    return Dataset.from_iris(tuple(default), tuple(named))


def _check_prefixes(text: str, tokens: list[Token], base: str) -> None:
    """Raise BadRequest for a name whose prefix is not declared; the parser would expect an unrelated word there."""
    declared = _declared(tokens, base)[1]
    for each in tokens:
        prefix, colon, _ = each.text.partition(":")
        if each.kind == "name" and colon and prefix != "_" and prefix not in declared:
            iri = PREFIXES.get(prefix, "…")
            raise syntax_error(
                f"The prefix {prefix}: is not declared; begin with PREFIX {prefix}: <{iri}>.", text, each
            )


def _declared(tokens: list[Token], base: str) -> tuple[str, dict[str, str]]:
    """Return the base IRI and the namespaces by prefix. Raises PayloadTooLarge."""
    if sum(each.word in ("BASE", "PREFIX", "FROM") for each in tokens) > MAX_DECLARATIONS:
        raise PayloadTooLarge(f"The query has more than {MAX_DECLARATIONS} of BASE, PREFIX and FROM.")
    prefixes: dict[str, str] = {}
    for index, each in enumerate(tokens):
        rest = tokens[index + 1 : index + 3]
        if each.word == "BASE" and rest and rest[0].kind == "iri":
            base = _join(base, rest[0].text[1:-1])
        elif each.word == "PREFIX" and len(rest) == 2 and rest[1].kind == "iri":
            prefixes[rest[0].text.removesuffix(":")] = _join(base, rest[1].text[1:-1])
    return base, prefixes


def _iri(text: str, term: Token, prefixes: dict[str, str], base: str) -> str:
    if term.kind == "iri":
        return _join(base, term.text[1:-1])
    prefix, _, local = term.text.partition(":")
    if term.kind != "name" or prefix not in prefixes:
        raise syntax_error("Here an IRI is expected, or a name whose prefix is declared.", text, term)
    return prefixes[prefix] + re.sub(r"\\(.)", r"\1", local)


def _join(base: str, reference: str) -> str:
    said = re.sub(r"\\u([0-9A-Fa-f]{4})|\\U([0-9A-Fa-f]{8})", lambda match: _character(match[1] or match[2]), reference)
    try:
        joined = urljoin(base, said) if len(said) <= MAX_IRI else said
    except ValueError as error:
        raise BadRequest(f"{said[:200]} is no IRI.") from error
    if len(joined) > MAX_IRI:
        raise BadRequest(f"An IRI has {len(joined)} characters; {MAX_IRI} are the most.")
    return joined


def _character(digits: str) -> str:
    code = int(digits, 16)
    return chr(code) if code < 0x110000 and not 0xD800 <= code < 0xE000 else "\ufffd"
