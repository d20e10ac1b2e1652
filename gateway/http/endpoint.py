"""The one place that every resource passes through: methods, negotiation, ETag, Link, errors (DESIGN "HTTP")."""

import logging
from collections.abc import Callable
from dataclasses import dataclass

from pyoxigraph import Triple
from starlette.requests import ClientDisconnect, Request
from starlette.responses import Response
from starlette.types import Receive, Scope, Send

from gateway.errors import FleetError, MethodNotAllowed, NotAcceptable, NotFound, PreconditionFailed
from gateway.graph.build import Graph
from gateway.graph.serialise import MEDIA_TYPES, render
from gateway.graph.tree import Redirect, Resource, Tree
from gateway.graph.vocab import PREFIXES
from gateway.http.conditional import etag, not_modified, precondition_holds
from gateway.http.invoke import BODY_TYPES, field, invoke
from gateway.http.links import LINKSET_TYPES, Link, link_header, linkset_json, linkset_text
from gateway.http.negotiation import choose
from gateway.http.problem import problem_body
from gateway.live import Live

log = logging.getLogger(__name__)

# The whole header block stays under 4 KiB, and Link is not alone in it.
_LINK_BYTES = 3584
_READ = ("GET", "HEAD", "OPTIONS")


@dataclass(frozen=True)
class Representation:
    """A rendered representation with what identifies it."""

    body: bytes
    media_type: str

    @property
    def etag(self) -> str:
        return etag(self.body)


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
    found = Tree(live.fleet, live.invocations, base).resolve(request.scope["path"])
    if found is None:
        raise NotFound(f"There is no resource at {request.url.path}; browse from {base}/.")
    if isinstance(found, Redirect):
        query = f"?{request.url.query}" if request.url.query else ""
        return Response(status_code=308, headers={"location": base + found.path + query})
    allow = _allow(found)
    if request.method not in allow:
        raise MethodNotAllowed(f"{request.method} is not possible here; {', '.join(allow)} are.", allow=allow)
    if request.method == "OPTIONS":
        return Response(status_code=204, headers=_options(found, allow))
    if request.method in ("GET", "HEAD"):
        return _read(request, found, base)
    _check_if_match(request, found, base)
    return await invoke(request, found, live, lambda resource: negotiated(request, resource, base))


def problem_response(request: Request, error: FleetError) -> Response:
    """Problem details for ``error`` in the form that Accept asks for."""
    instance = request.state.base + request.url.path
    body, media_type = problem_body(error, field(request, "accept"), instance, PREFIXES)
    headers = {"content-type": media_type, "vary": "Accept", "cache-control": "no-store", **error.headers}
    return Response(b"" if request.method == "HEAD" else body, error.status, headers)


def negotiated(request: Request, resource: Resource, base: str) -> Representation:
    """The representation that Accept prefers; NotAcceptable with the list of what there is."""
    offered = _offered(resource)
    media_type = choose(field(request, "accept"), offered)
    if media_type is None:
        raise NotAcceptable(f"Available here: {', '.join(offered)}.", offered=offered)
    return represent(resource, media_type, base)


def represent(resource: Resource, media_type: str, base: str) -> Representation:
    if resource.linkset_of is not None:
        anchor, links = base + resource.linkset_of.path, _links(resource.linkset_of, base)
        write: Callable[..., bytes] = linkset_json if media_type == LINKSET_TYPES[0] else linkset_text
        return Representation(write(anchor, links), media_type)
    if media_type in resource.documents:
        return Representation(resource.documents[media_type](), media_type)
    return Representation(
        render(_triples(resource), media_type, PREFIXES, base=base + resource.path, title=resource.title), media_type
    )


def _read(request: Request, resource: Resource, base: str) -> Response:
    representation = negotiated(request, resource, base)
    headers = {
        "etag": representation.etag,
        "vary": "Accept",
        "cache-control": "no-cache",
        "link": _link(resource, base),
    }
    if not_modified(field(request, "if-none-match"), representation.etag):
        return Response(status_code=304, headers=headers)
    text = representation.media_type.startswith("text/")
    headers["content-type"] = representation.media_type + ("; charset=utf-8" if text else "")
    headers |= _options(resource, _allow(resource))
    # Starlette computes Content-Length from the body; the server itself leaves the body of a HEAD out.
    return Response(representation.body, headers=headers)


def _check_if_match(request: Request, resource: Resource, base: str) -> None:
    header = field(request, "if-match")
    if header is None:
        return
    # The current ETag of any representation will do: the client may have read JSON-LD and write Turtle.
    etags = {represent(resource, media_type, base).etag for media_type in _offered(resource)}
    if not precondition_holds(header, etags):
        raise PreconditionFailed("The resource has changed since; none of the entity tags in If-Match is current.")


def _allow(resource: Resource) -> tuple[str, ...]:
    return (*_READ, "POST", "PUT") if resource.action else _READ


def _options(resource: Resource, allow: tuple[str, ...]) -> dict[str, str]:
    headers = {"allow": ", ".join(allow)}
    if resource.action is not None:
        headers |= {"accept-post": ", ".join(BODY_TYPES), "accept-put": ", ".join(BODY_TYPES)}
    return headers


def _offered(resource: Resource) -> tuple[str, ...]:
    if resource.linkset_of is not None:
        return LINKSET_TYPES
    rdf = MEDIA_TYPES if resource.describe is not None else ()
    return (*rdf, *resource.documents)


def _triples(resource: Resource) -> list[Triple]:
    graph = Graph()
    if resource.describe is not None:
        resource.describe(graph)
    return graph.triples


def _links(resource: Resource, base: str) -> list[Link]:
    return [Link(base + path, "related") for path in (*resource.own, *resource.parts)]


def _link(resource: Resource, base: str) -> str:
    types = [Link(iri.value, "type") for iri in resource.interaction]
    own = types + [Link(base + path, "related") for path in resource.own]
    parts = [Link(base + path, "related") for path in resource.parts]
    linkset = base + resource.linkset if resource.has_linkset else None
    return link_header(own, parts, linkset, limit=_LINK_BYTES)
