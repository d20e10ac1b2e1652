"""Errors of the queries.

``ResultTooLarge`` (413, result-too-large), ``TooManyQueries`` (429, too-many-queries),
``QueryTooCostly`` (503, query-too-costly).
"""

# ruff: noqa: N818  (named like the errors of linked_fleet_gateway.base.errors)

from linked_fleet_gateway.base.errors import FleetError, PayloadTooLarge


class ResultTooLarge(PayloadTooLarge):
    """The result exceeds the limit. Results are never truncated."""

    code, title = "result-too-large", "The result of the query is too large"


class TooManyQueries(FleetError):
    """Too many queries of the client are waiting (RFC 6585, 4)."""

    status, code, title = 429, "too-many-queries", "The client has too many queries waiting"
    retry_after_s = 1


class QueryTooCostly(FleetError):
    """A query was ended at its limit of time or memory. Other requests are not affected; repeating it does not help."""

    status, code, title = 503, "query-too-costly", "The query takes too much time or memory"
