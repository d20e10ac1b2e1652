"""The page of the endpoint, and results as a page; the latter is rendered in the query process."""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from urllib.parse import urlencode

from pyoxigraph import BlankNode, Literal, NamedNode, QueryBoolean, QuerySolutions, Triple

from linked_fleet_base.errors import BadRequest, FleetError
from linked_fleet_gateway.extensions.pages.languages import add_folder, known, message, say, speaking
from linked_fleet_gateway.extensions.pages.page import render
from linked_fleet_gateway.extensions.pages.texts import clean, foreign_iri_text, number
from linked_fleet_gateway.extensions.pages.values import Facts
from linked_fleet_gateway.extensions.pages.views import PageView, Part, Place, add_view, places
from linked_fleet_gateway.extensions.query.examples import EXAMPLES
from linked_fleet_gateway.extensions.query.functions import LF
from linked_fleet_gateway.extensions.query.messages import QueryRequest, Refused, size_refusal
from linked_fleet_gateway.faces import NavigationEntry, Reader
from linked_fleet_rdf.vocabulary import DCTERMS, NUMERIC, PREFIXES, RDFS, SD, SH

_CELL_BYTES = 64
_LONGEST_ADDRESS = 1500
_NUMERIC = frozenset(NUMERIC)


@dataclass(frozen=True)
class Cell:
    """A term as shown; ``href`` is empty if a browser cannot follow it, ``number`` is its numeric value, if any."""

    text: str
    href: str = ""
    title: str = ""
    number: str = ""


@dataclass(frozen=True)
class Problem:
    """The error of a query; ``line`` and ``column`` count from 1, 0 for an error without a position."""

    title: str
    detail: str
    line: int = 0
    column: int = 0


def preload() -> None:
    """Load everything that pages need: afterwards no file can be opened."""
    add_view(VIEW)  # its folder contains the template
    add_folder(Path(__file__).parent / "languages")
    _page("", "http://localhost", [], Reader())


def page_of(result: QuerySolutions | QueryBoolean | Sequence[Triple], ask: QueryRequest) -> bytes:
    """Return the result as a page. Raises Refused if it is too large."""
    with speaking(ask.reader.languages):
        return _page_of(result, ask)


def _page_of(result: QuerySolutions | QueryBoolean | Sequence[Triple], ask: QueryRequest) -> bytes:
    entries = places("/query", ask.reader.restricted_paths, entries=[NavigationEntry(*each) for each in ask.navigation])
    if isinstance(result, QueryBoolean):
        summary, formats = say("Yes.") if result else say("No."), _formats(ask, ("json", "xml"))
        return _page(ask.query, ask.base, entries, ask.reader, summary=summary, formats=formats)
    if isinstance(result, QuerySolutions):
        names, others = [each.value for each in result.variables], ("csv", "json", "tsv", "xml")
        rows = ([row[name] for name in names] for row in result)
    else:
        names, others = ["subject", "predicate", "object"], ("turtle", "jsonld", "ntriples", "rdfxml")
        rows = ([each.subject, each.predicate, each.object] for each in result)
    shown = _bounded(rows, ask)
    summary = say("{count} rows", count=len(shown)) if len(shown) != 1 else say("1 row")
    formats = _formats(ask, others)
    return _page(ask.query, ask.base, entries, ask.reader, summary=summary, names=names, rows=shown, formats=formats)


def entries_for(reader: Reader, entries: Iterable[NavigationEntry]) -> list[NavigationEntry]:
    """Return the entries of the navigation in the language of the reader."""
    with speaking(reader.languages):
        return [replace(each, title=known(each.title)) for each in entries]


def refusal_page(query: str, base: str, reader: Reader, error: FleetError) -> bytes:
    """Return a page with the query and the reason for its refusal."""
    line, column = (error.line, error.column) if isinstance(error, BadRequest) else (None, None)
    problem = Problem(error.title, error.detail, line or 0, column or 0)
    with speaking(reader.languages):
        return _page(query, base, places("/query", reader.restricted_paths), reader, problem=problem)


def _bounded(rows: Iterable[Sequence[object]], ask: QueryRequest) -> list[list[Cell]]:
    shown: list[list[Cell]] = []
    size = 0
    for row in rows:
        cells = [_cell(term, ask.base + "/") for term in row]
        size += sum(_CELL_BYTES + len(each.text) + len(each.href) for each in cells)
        if size > ask.most_bytes:
            raise Refused(size_refusal(ask.most_bytes))
        shown.append(cells)
    return shown


def _cell(term: object, root: str) -> Cell:
    if isinstance(term, NamedNode):
        href = term.value if term.value.startswith(("http://", "https://")) else ""
        return Cell(_shortened(term.value, root), href, clean(term.value))
    if isinstance(term, Literal):
        value = _value(term)
        text = clean(term.value) if value is None else number(value)
        return Cell(text, "", _title(term, text), "" if value is None else repr(value))
    return Cell("" if term is None else clean(str(term)) if not isinstance(term, BlankNode) else "[]")


def _shortened(iri: str, root: str) -> str:
    """Return the path of a resource of this fleet, a term with its prefix, anything else by name and host."""
    if iri.startswith(root):
        return clean(iri.removeprefix(root)) or "/"
    for prefix, namespace in PREFIXES.items():
        if iri.startswith(namespace) and len(iri) > len(namespace):
            return clean(f"{prefix}:{iri.removeprefix(namespace)}")
    return foreign_iri_text(iri)


def _value(term: Literal) -> float | None:
    """Return the value of a finite number, for charts."""
    if term.datatype not in _NUMERIC:
        return None
    try:
        value = float(term.value)
    except ValueError:  # an invalid lexical form
        return None
    return value if math.isfinite(value) else None


def _title(term: Literal, text: str) -> str:
    """Return the details that the text hides: rounded digits, language, datatype."""
    kind = term.language or _shortened(term.datatype.value, "")
    return clean(kind if text == term.value else f"{term.value} {kind}")


def _formats(ask: QueryRequest, keys: Sequence[str]) -> dict[str, str]:
    """Return the URLs of other representations of the same result, by format name."""
    said = [("query", ask.query)]
    said += [("default-graph-uri", each) for each in ask.default or ()]
    said += [("named-graph-uri", each) for each in ask.named or ()]
    return {key: f"{ask.base_iri}?{urlencode([*said, ('as', key)])}" for key in keys}


def _page(
    query: str,
    base: str,
    entries: Sequence[Place],
    reader: Reader,
    *,
    summary: str = "",
    names: Sequence[str] = (),
    rows: Sequence[Sequence[Cell]] = (),
    formats: Mapping[str, str] = {},
    problem: Problem | None = None,
) -> bytes:
    with speaking(reader.languages):
        return render(
            "results.html", query=clean(query), root=f"{base}/", places=entries, reader=reader, summary=summary,
            names=names, rows=rows, formats=formats, problem=problem, examples=EXAMPLES, here=_here(query),
        )  # fmt: skip


def _here(query: str) -> str:
    """Return the address of the page, without a query that is too long to be led back to."""
    address = f"/query?{urlencode({'query': query})}"
    return address if len(address) <= _LONGEST_ADDRESS else "/query"


# -- the endpoint ------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Example:
    title: str
    comment: str
    text: str


def query(facts: Facts, iri: NamedNode) -> Part:
    """Show the endpoint with its example queries."""
    examples = [
        Example(*(facts.text(each, predicate) for predicate in (DCTERMS.title, RDFS.comment, SH.select)))
        for each in facts.all(iri, LF.example)
    ]
    return Part({"examples": examples}, {LF.example, RDFS.comment})


VIEW = PageView(
    SD.Service,
    Path(__file__).parent / "templates" / "query.html",
    query,
    help=message("Ask for anything that is known of this fleet. Begin with one of the examples."),
    guide="docs/MAP.md",
)
