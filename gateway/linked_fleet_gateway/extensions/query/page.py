"""The page of the endpoint, and results as a page: those are written in the query process, beside the event loop."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import urlencode

from pyoxigraph import BlankNode, Literal, NamedNode, QueryBoolean, QuerySolutions, Triple

from linked_fleet_gateway.extensions.pages.labels import clean
from linked_fleet_gateway.extensions.pages.navigation import places
from linked_fleet_gateway.extensions.pages.page import render
from linked_fleet_gateway.extensions.pages.values import Facts
from linked_fleet_gateway.extensions.pages.views import PageView, Part, add_view
from linked_fleet_gateway.extensions.query.messages import Ask, Refused, too_large
from linked_fleet_gateway.http.html import NavigationEntry
from linked_fleet_gateway.rdf.vocabulary import DCTERMS, LF, RDFS, SD, SH

_CELL_BYTES = 64


@dataclass(frozen=True)
class Cell:
    """A term as it is shown, ``href`` empty for what a browser cannot follow."""

    text: str
    href: str = ""
    title: str = ""


def warm() -> None:
    """Load what pages take: afterwards no file can be opened."""
    add_view(VIEW)  # whose folder has the template
    _page(None, [], [], "", {})


def page_of(result: QuerySolutions | QueryBoolean | Sequence[Triple], ask: Ask) -> bytes:
    """Refused when it would have too many bytes."""
    if isinstance(result, QueryBoolean):
        return _page(ask, [], [], "Yes." if result else "No.", _formats(ask, ("json", "xml")))
    if isinstance(result, QuerySolutions):
        names, others = [each.value for each in result.variables], ("json", "xml", "csv", "tsv")
        rows = ([row[name] for name in names] for row in result)
    else:
        names, others = ["subject", "predicate", "object"], ("turtle", "jsonld", "ntriples", "rdfxml")
        rows = ([each.subject, each.predicate, each.object] for each in result)
    shown = _bounded(rows, ask)
    return _page(ask, names, shown, f"{len(shown)} rows" if len(shown) != 1 else "1 row", _formats(ask, others))


def _bounded(rows: Iterable[Sequence[object]], ask: Ask) -> list[list[Cell]]:
    shown: list[list[Cell]] = []
    size = 0
    for row in rows:
        cells = [_cell(term, ask.base + "/") for term in row]
        size += sum(_CELL_BYTES + len(each.text) + len(each.href) for each in cells)
        if size > ask.most_bytes:
            raise Refused(too_large(ask.most_bytes))
        shown.append(cells)
    return shown


def _cell(term: object, root: str) -> Cell:
    if isinstance(term, NamedNode):
        href = term.value if term.value.startswith(("http://", "https://")) else ""
        return Cell(clean(term.value.removeprefix(root) or "/"), href, clean(term.value))
    if isinstance(term, Literal):
        return Cell(clean(term.value), "", clean(term.language or term.datatype.value))
    return Cell("" if term is None else clean(str(term)) if not isinstance(term, BlankNode) else "[]")


def _formats(ask: Ask, keys: Sequence[str]) -> dict[str, str]:
    """Other representations of the result of the same query, by what picks them."""
    said = [("query", ask.query)]
    said += [("default-graph-uri", each) for each in ask.default or ()]
    said += [("named-graph-uri", each) for each in ask.named or ()]
    return {key: f"{ask.base_iri}?{urlencode([*said, ('as', key)])}" for key in keys}


def _page(
    ask: Ask | None,
    names: Sequence[str],
    rows: Sequence[Sequence[Cell]],
    summary: str,
    formats: Mapping[str, str],
) -> bytes:
    query, shown = (
        ("", [])
        if ask is None
        else (
            clean(ask.query),
            places("/query", ask.audited, entries=[NavigationEntry(*each) for each in ask.navigation]),
        )
    )
    return render("results.html", query=query, places=shown, names=names, rows=rows, summary=summary, formats=formats)


# -- the endpoint ------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Example:
    title: str
    comment: str
    text: str


def query(facts: Facts, iri: NamedNode) -> Part:
    """The endpoint: what can be asked."""
    examples = [
        Example(*(facts.text(each, predicate) for predicate in (DCTERMS.title, RDFS.comment, SH.select)))
        for each in facts.all(iri, LF.example)
    ]
    return Part({"examples": examples}, {LF.example, RDFS.comment})


VIEW = PageView(SD.Service, Path(__file__).parent / "templates" / "query.html", query)
