"""Evaluation of one query on a store, in a process of its own that may be killed."""

import io
import logging
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

from pyoxigraph import (
    BlankNode,
    Literal,
    NamedNode,
    QueryBoolean,
    QueryResultsFormat,
    QuerySolutions,
    Store,
    Triple,
    Variable,
)

from linked_fleet_gateway.extensions.query import page
from linked_fleet_gateway.extensions.query.messages import QueryRequest, Refusal, Refused, size_refusal
from linked_fleet_rdf.serialise import RDF_TYPES, WriteError, render
from linked_fleet_rdf.vocabulary import LF, PREFIXES, RDF

ROWS: Mapping[str, QueryResultsFormat] = {
    "application/sparql-results+json": QueryResultsFormat.JSON,
    "application/sparql-results+xml": QueryResultsFormat.XML,
    "application/json": QueryResultsFormat.JSON,
    "text/csv": QueryResultsFormat.CSV,
    "text/tab-separated-values": QueryResultsFormat.TSV,
}
"""Media types of solutions (SPARQL 1.1 Query Results JSON, XML, CSV and TSV)."""
_TERM_BYTES = 200  # lower bound of the size of a triple, for counting
_LONGEST = 400
_POSITION = re.compile(r"error at (\d+):(\d+): (.*)", re.DOTALL)

log = logging.getLogger(__name__)

Function = Callable[..., Any]


@dataclass(frozen=True)
class VisibleGraphs:
    """The graphs that the caller may see; ``whole`` if the store has no others."""

    graphs: Sequence[NamedNode]
    whole: bool


@cache
def preload(media_type: str) -> None:
    """Load the writer of a media type: afterwards no file can be opened."""
    if media_type in RDF_TYPES:
        render([Triple(LF.Fleet, RDF.type, LF.Fleet)], media_type, PREFIXES, base="http://localhost/")
    elif media_type not in ROWS:
        page.preload()


def evaluate(store: Store, ask: QueryRequest, seen: VisibleGraphs, functions: Mapping[NamedNode, Function]) -> bytes:
    """Return the result in ``ask.media_type``. Raises Refused."""
    try:
        result = store.query(
            ask.query,
            base_iri=ask.base_iri,
            substitutions=dict(_bindings(ask.bindings)) or None,
            custom_functions=dict(functions),
            **_dataset(ask, seen),
        )
        if ask.only_check:
            return b""
        return _written(result, ask)
    except SyntaxError as error:
        raise Refused(_malformed(str(error))) from error
    except RuntimeError as error:  # of bindings
        raise Refused(Refusal(reason="wrong", detail=str(error)[:_LONGEST])) from error
    except WriteError as error:
        raise Refused(Refusal(reason="wrong", detail=f"Ask for another media type: {error}")) from error
    except MemoryError as error:
        raise Refused(Refusal(reason="failed", detail="memory")) from error
    except OSError as error:
        log.exception("a query asked for more than is in the store")
        raise Refused(Refusal(reason="wrong", detail="The query cannot be evaluated here.")) from error


def _dataset(ask: QueryRequest, seen: VisibleGraphs) -> dict[str, Any]:
    """Restrict the dataset to visible graphs. Both parts are always set, or the query's own FROM would apply."""
    if ask.default is None and ask.named is None and seen.whole:
        return {"use_default_graph_as_union": True}
    by_name = {graph.value: graph for graph in seen.graphs}

    def among(asked: Sequence[str] | None) -> list[NamedNode]:
        return (
            list(seen.graphs) if asked is None else [by_name[each] for each in dict.fromkeys(asked) if each in by_name]
        )

    return {"default_graph": among(ask.default), "named_graphs": among(ask.named)}


def _bindings(said: Mapping[str, Mapping[str, str]]) -> Iterator[tuple[Variable, NamedNode | BlankNode | Literal]]:
    for name, term in said.items():
        value = term["value"]
        if term["type"] == "uri":
            yield Variable(name), NamedNode(value)
        elif "xml:lang" in term:
            yield Variable(name), Literal(value, language=term["xml:lang"])
        else:
            datatype = term.get("datatype")
            yield Variable(name), Literal(value, datatype=NamedNode(datatype) if datatype else None)


def _written(result: Any, ask: QueryRequest) -> bytes:
    if isinstance(result, QuerySolutions | QueryBoolean):
        if ask.media_type == "text/html":
            return page.page_of(result, ask)
        output = _Bounded(ask.most_bytes)
        result.serialize(output, format=ROWS[ask.media_type])
        return output.getvalue()
    triples: list[Triple] = []
    for triple in result:
        triples.append(triple)
        if len(triples) * _TERM_BYTES > ask.most_bytes:
            raise Refused(size_refusal(ask.most_bytes))
    if ask.media_type == "text/html":
        return page.page_of(triples, ask)
    written = render(triples, ask.media_type, PREFIXES, base=ask.base + "/")
    if len(written) > ask.most_bytes:
        raise Refused(size_refusal(ask.most_bytes))
    return written


class _Bounded(io.BytesIO):
    """A buffer with a size limit."""

    def __init__(self, most: int) -> None:
        super().__init__()
        self._most = most

    def write(self, content: Any) -> int:
        if self.tell() + len(content) > self._most:
            raise Refused(size_refusal(self._most))
        return super().write(content)


def _malformed(said: str) -> Refusal:
    found = _POSITION.match(said)
    if found is None:
        return Refusal(reason="wrong", detail=f"This is not a SPARQL query: {said[:_LONGEST]}")
    words = " ".join(found[3].split())
    # The parser also lists every character that could have followed.
    detail = "This is not a SPARQL query" + (f": {words}." if len(words) <= _LONGEST else ".")
    return Refusal(reason="wrong", detail=detail, line=int(found[1]), column=int(found[2]))
