"""SPARQL 1.1 queries on consistent snapshots of the live fleet, evaluated in a separate process."""

from collections.abc import Mapping, Sequence
from dataclasses import astuple
from types import TracebackType

from pyoxigraph import (
    BlankNode,
    Literal,
    NamedNode,
    QueryResultsFormat,
    QuerySolutions,
    RdfFormat,
    parse_query_results,
    serialize,
)

from linked_fleet_gateway.api import NavigationEntry, Robot
from linked_fleet_gateway.extensions.query.messages import HypotheticalRobot, QueryRequest
from linked_fleet_gateway.extensions.query.process import Feed, QueryProcess
from linked_fleet_gateway.extensions.query.sparql_syntax import Dataset, Query, check_select, parse_query
from linked_fleet_gateway.extensions.query.turns import FairTurns
from linked_fleet_gateway.faces import HTML, Reader, View
from linked_fleet_gateway.serving import Live
from linked_fleet_state.carried import CarriedPose
from linked_fleet_state.model import Pose

LIMIT_S = 5.0
"""Limit of processor time for the evaluation of one query, in seconds."""
MAX_RESULT_BYTES = 8 * 2**20
MAX_SELECTED_BYTES = 2**20
"""Largest result of an internal query, which is parsed on the event loop."""
JSON_RESULTS = "application/sparql-results+json"

Term = NamedNode | BlankNode | Literal
_NOBODY = Reader()


class Queries:
    """The query service; an async context manager."""

    def __init__(self, live: Live, limit_s: float = LIMIT_S, navigation: Sequence[NavigationEntry] = ()) -> None:
        """Create the service; ``navigation`` are the entries of extensions for result pages."""
        self._live, self._limit_s = live, limit_s
        self._navigation = tuple(navigation)
        self._turns = FairTurns()
        self._process = QueryProcess(lambda: Feed(live.fleet, live.invocations, self._links))

    def _links(self, robot: Robot, path: str) -> list[tuple[NamedNode, str]]:
        """Return the links of a robot to its branches; none if they cannot be told, which does not end the query."""
        with self._live.faults.guard("SPARQL", robot.name, "branches"):
            return self._live.branches.robot_links(robot, path)
        return []

    async def __aenter__(self) -> "Queries":
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        await self._process.close()

    @property
    def running(self) -> bool:
        """True if the query process runs."""
        return self._process.running

    async def select(
        self,
        query: str,
        base: str,
        sees: View,
        bindings: Mapping[str, Term] = {},
        *,
        instead: Sequence[HypotheticalRobot] = (),
        client: str | None = None,
    ) -> list[dict[str, Term]]:
        """Return the solutions of a SELECT query, without unbound variables.

        ``base`` is scheme and authority of all IRIs. ``bindings`` are values of variables without question marks, which
        the query must select. ``client`` has its own turns; without it, callers with the same view share theirs.
        ``instead`` are robots in a hypothetical state. Raises BadRequest, PayloadTooLarge, ResultTooLarge,
        QueryTooCostly, TooManyQueries, Busy, LibraryMissing.
        """
        check_select(query)
        body = await self.run(
            parse_query(query, base + "/query"), base, sees, JSON_RESULTS,
            client=client, bindings=bindings, instead=instead, most=MAX_SELECTED_BYTES,
        )  # fmt: skip
        found = parse_query_results(body, format=QueryResultsFormat.JSON)
        assert isinstance(found, QuerySolutions)
        names = [each.value for each in found.variables]
        rows = ({name: row[name] for name in names} for row in found)
        return [{name: term for name, term in row.items() if isinstance(term, Term)} for row in rows]

    async def check(self, query: str, base: str, client: str | None = None) -> list[str]:
        """Return the variables of a valid SELECT query without evaluating it. Raises FleetError."""
        variables = check_select(query)
        nobody = View((), "")
        await self.run(parse_query(query, base + "/query"), base, nobody, JSON_RESULTS, client=client, only_check=True)
        return variables

    def _entries(self, reader: Reader) -> list[tuple[str, str, int, bool, bool]]:
        """Return the navigation in the language of the reader: the process lacks translations of other extensions."""
        from linked_fleet_gateway.extensions.query.page import entries_for  # for pages only

        return [astuple(each) for each in entries_for(reader, self._navigation)]

    async def run(
        self,
        query: Query,
        base: str,
        sees: View,
        media_type: str,
        *,
        dataset: Dataset | None = None,
        client: str | None = None,
        bindings: Mapping[str, Term] = {},
        instead: Sequence[HypotheticalRobot] = (),
        most: int = MAX_RESULT_BYTES,
        only_check: bool = False,
        reader: Reader = _NOBODY,
    ) -> bytes:
        """Return the result in a media type that suits the query form.

        ``dataset`` overrides that of the query. ``reader`` is that of a page. Raises
        BadRequest, ResultTooLarge, QueryTooCostly, TooManyQueries, Busy, LibraryMissing.
        """
        asked = query.dataset if dataset is None or dataset == Dataset() else dataset

        def make(feed: Feed) -> QueryRequest:
            view = self._live.tree(base, sees).view
            poses = self._live.branches.poses()
            return QueryRequest(
                news=feed.news(),
                query=query.text,
                navigation=self._entries(reader) if media_type == HTML else [],
                base=base,
                base_iri=base + "/query",
                patterns=sees.patterns,
                caller=sees.name,
                default=asked.default,
                named=asked.named,
                branches=[(term.value, path) for term, path in self._live.branches.fleet_links()],
                invocations=[each for each in feed.fleet_invocations() if view.invocations.get(each.id) is not None],
                graphs=[(path, _n_triples(said)) for path, said in self._live.branches.graphs(view)],
                media_type=media_type,
                most_bytes=most,
                limit_s=self._limit_s,
                bindings={name: _json(term) for name, term in bindings.items()},
                poses={path: each for path, each in poses.items() if isinstance(each, Pose)},
                carried={path: each for path, each in poses.items() if isinstance(each, CarriedPose)},
                hypothetical_robots=tuple(instead),
                only_check=only_check,
                reader=reader,
            )

        async with self._turns.turn(client if client is not None else "view " + sees.name):
            return await self._process.ask(make)


def _n_triples(triples: Sequence[object]) -> bytes:
    written = serialize(triples, format=RdfFormat.N_TRIPLES)  # type: ignore[arg-type]
    assert written is not None  # None only when it writes to a file
    return written


def _json(term: Term) -> dict[str, str]:
    """Return a term in SPARQL 1.1 Query Results JSON."""
    if isinstance(term, NamedNode):
        return {"type": "uri", "value": term.value}
    if isinstance(term, BlankNode):
        raise TypeError("a blank node of another document cannot be a binding")
    if term.language is not None:
        return {"type": "literal", "value": term.value, "xml:lang": term.language}
    return {"type": "literal", "value": term.value, "datatype": term.datatype.value}
