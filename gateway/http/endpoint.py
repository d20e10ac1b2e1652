"""The one place that every resource passes through: methods, negotiation, ETag, Link, errors (DESIGN "HTTP")."""

import logging
from urllib.parse import quote as percent

from starlette.requests import ClientDisconnect, Request
from starlette.responses import Response
from starlette.types import Receive, Scope, Send

from gateway.errors import BadRequest, FleetError, MethodNotAllowed, NotFound, PreconditionFailed
from gateway.graph.tree import Redirect, Resource, Tree
from gateway.graph.vocab import PREFIXES
from gateway.http.conditional import not_modified, precondition_holds
from gateway.http.fields import field
from gateway.http.invoke import BODY_TYPES, invoke
from gateway.http.links import Link, link_header
from gateway.http.problem import problem
from gateway.http.representation import etags, negotiated
from gateway.live import Live

log = logging.getLogger(__name__)

# The whole header block stays under 4 KiB, and Link is not alone in it.
_LINK_BYTES = 3584
_READ = ("GET", "HEAD", "OPTIONS")
_WRITE = ("POST", "PUT")
_LONGEST_NAMED = 200


async def resources(scope: Scope, receive: Receive, send: Send) -> None:
    """The ASGI application for every path and every method (R0.10: a 405 carries the Allow of its own resource)."""
    request = Request(scope, receive)
    response = await _respond(request)
    await response(scope, receive, send)


async def _respond(request: Request) -> Response:
    base: str = request.state.base
    try:
        return await _answer(request, base)
    except ClientDisconnect:
        raise
    except FleetError as error:
        return problem_response(request, error)
    except Exception:
        # The boundary: what nobody foresaw is logged whole and answered without a trace of the stack.
        log.exception("unforeseen error at %s %s", request.method, request.url.path)
        return problem_response(request, FleetError("The gateway failed to answer; its log has the reason."))


async def _answer(request: Request, base: str) -> Response:
    live: Live = request.app.state.live
    path: str = request.scope["path"]
    if path == "*" and request.method == "OPTIONS":
        return Response(status_code=204, headers={"allow": ", ".join((*_READ, *_WRITE))})
    if not path.startswith("/"):
        raise BadRequest(f"The request target is no path, such as /, and no URL below {base}/.")
    # An encoded slash separates nothing (RFC 3986, 2.2), and no name in the tree has one.
    encoded_slash = b"%2f" in request.scope["raw_path"].lower()
    found = None if encoded_slash else Tree(live.fleet, live.invocations, base).resolve(path)
    if found is None:
        raise NotFound(f"There is no resource at {path[:_LONGEST_NAMED]}; browse from {base}/.")
    if isinstance(found, Redirect):
        query = f"?{request.url.query}" if request.url.query else ""
        return Response(status_code=308, headers={"location": base + found.path + query})
    allow = _allow(found)
    if request.method not in allow:
        raise MethodNotAllowed(f"{request.method} is not possible here; {', '.join(allow)} are.", allow=allow)
    if request.method == "OPTIONS":
        return Response(status_code=204, headers=_options(found, allow))
    _check_preconditions(request, found, base)
    if found.action is not None and request.method in _WRITE:
        return await invoke(request, found.action, live, base)
    return _read(request, found, base)


def problem_response(request: Request, error: FleetError) -> Response:
    """Problem details for ``error`` in the form that Accept asks for."""
    path = percent(request.scope["path"], safe="/~")
    instance = request.state.base + path if len(path) <= _LONGEST_NAMED else None
    body, headers = problem(error, field(request, "accept"), instance, PREFIXES)
    # HEAD has the headers of GET, its Content-Length too; the server itself leaves the body out.
    return Response(body, error.status, headers)


def _read(request: Request, resource: Resource, base: str) -> Response:
    representation = negotiated(field(request, "accept"), resource, base)
    headers = {
        "etag": representation.etag,
        "vary": "Accept",
        "cache-control": "no-cache",
        "link": _link(resource, base),
    }
    if not_modified(field(request, "if-none-match"), representation.etag):
        return Response(status_code=304, headers=headers)
    headers["content-type"] = representation.content_type
    headers |= _options(resource, _allow(resource))
    # Starlette computes Content-Length from the body; the server itself leaves the body of a HEAD out.
    return Response(representation.body, headers=headers)


def _check_preconditions(request: Request, resource: Resource, base: str) -> None:
    """If-Match, and for writes If-None-Match (RFC 9110, 13.1.1 and 13.1.2)."""
    wanted = field(request, "if-match")
    unwanted = None if request.method in _READ else field(request, "if-none-match")
    if wanted is None and unwanted is None:
        return
    present = etags(resource, base)
    if not precondition_holds(wanted, present):
        raise PreconditionFailed("The resource has changed since; none of the entity tags in If-Match is current.")
    if any(not_modified(unwanted, tag) for tag in present):
        raise PreconditionFailed("If-None-Match names the present state of the resource.")


def _allow(resource: Resource) -> tuple[str, ...]:
    return (*_READ, *_WRITE) if resource.action else _READ


def _options(resource: Resource, allow: tuple[str, ...]) -> dict[str, str]:
    headers = {"allow": ", ".join(allow)}
    if resource.action is not None:
        headers |= {"accept-post": ", ".join(BODY_TYPES), "accept-put": ", ".join(BODY_TYPES)}
    return headers


def _link(resource: Resource, base: str) -> str:
    types = [Link(iri.value, "type") for iri in resource.interaction]
    own = types + [Link(base + path, "related") for path in resource.own]
    parts = [Link(base + path, "related") for path in resource.parts]
    linkset = base + resource.linkset if resource.has_linkset else None
    return link_header(own, parts, linkset, limit=_LINK_BYTES)
