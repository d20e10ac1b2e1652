"""The part of a page that shows the request and the gateway."""

from linked_fleet_gateway.http.callers import SUBSCRIPTIONS_RIGHTS
from linked_fleet_gateway.http.request import Request
from linked_fleet_gateway.resources.html import PageContext
from linked_fleet_gateway.resources.paths import robot_of


def page_context(request: Request, path: str) -> PageContext:
    """Return the context of the page at ``path``."""
    return PageContext(
        request.reader(path),
        _query(request.url.query) if request.scope["query_string"] else "",
        request.caller.has_any_right(SUBSCRIPTIONS_RIGHTS, robot_of(path)),
        request.services.data_warning(),
    )


def _query(query: str) -> str:
    """Return the query without the representation that it picks."""
    return "&".join(each for each in query.split("&") if not each.startswith("as="))
