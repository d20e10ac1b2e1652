"""Errors of the queries.

``ResultTooLarge`` (413, result-too-large), ``TooManyQueries`` (429, too-many-queries),
``QueryTooCostly`` (503, query-too-costly).
"""

# ruff: noqa: N818  (the names say what is wrong, as those of linked_fleet_gateway.base.errors)

from linked_fleet_gateway.base.errors import FleetError, PayloadTooLarge


class ResultTooLarge(PayloadTooLarge):
    """A result is given whole or not at all."""

    code, title = "result-too-large", "The result of the query is too large"


class TooManyQueries(FleetError):
    """RFC 6585, 4; some of the client's own are waiting already."""

    status, code, title = 429, "too-many-queries", "The client has too many queries waiting"

    def __init__(self, detail: str) -> None:
        super().__init__(detail, headers={"Retry-After": "1"})


class QueryTooCostly(FleetError):
    """A query was ended at its limit of time or memory; nothing else was disturbed. The same again fares no better."""

    status, code, title = 503, "query-too-costly", "The query takes too much time or memory"
