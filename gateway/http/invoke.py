"""Invoking an action: body → typed quantity → command → answer (flow "action"; R0.7, R0.8, RFC 7240)."""

from collections.abc import Callable
from typing import TYPE_CHECKING

from starlette.requests import Request
from starlette.responses import Response

from gateway.errors import BadRequest, PayloadTooLarge, UnsupportedMediaType
from gateway.fleet.invocations import Invocation
from gateway.graph.guard import admit
from gateway.graph.invocation import invocation_path
from gateway.graph.serialise import ParseError, parse
from gateway.graph.tree import Resource, Tree
from gateway.graph.vocab import PREFIXES
from gateway.http.negotiation import parse_content_type
from gateway.http.prefer import Prefer, parse_prefer
from gateway.live import Live

if TYPE_CHECKING:
    from gateway.http.endpoint import Representation

BODY_TYPES = ("text/turtle", "application/ld+json", "application/n-triples", "application/rdf+xml")
MAX_BODY_BYTES = 64 * 1024
_CONTEXT = "https://w3id.org/linked-fleet/context"


async def invoke(
    request: Request, resource: Resource, live: Live, representation: "Callable[[Resource], Representation]"
) -> Response:
    """204 with Location; 201 with the invocation by Prefer: return=representation, 202 by respond-async or wait."""
    action = resource.action
    assert action is not None
    base: str = request.state.base
    media_type, _ = parse_content_type(field(request, "content-type"), BODY_TYPES)
    _check_whole(request)
    prefer = parse_prefer(field(request, "prefer"))
    if prefer.return_ == "representation":
        representation(resource)  # as negotiable as the invocation will be: a 406 comes before the motion or never
    body = await read_body(request)
    iri = base + action.path
    context = {"@context": PREFIXES}
    try:
        triples = parse(body, media_type, iri, contexts={_CONTEXT: context, f"{base}/context": context})
    except ParseError as error:
        raise BadRequest(f"The body is no {media_type}: {error}", line=error.line, column=error.column) from error
    quantity = admit(triples, action.joint, iri)
    invocation = await live.invoke(action.robot, action.path, action.motion(quantity.value, quantity.unit))
    return await _answer(live, invocation, prefer, base, representation)


def _check_whole(request: Request) -> None:
    """The content itself, neither compressed (RFC 9110, 8.4 and 15.5.16) nor a part of it (14.5)."""
    coding = (field(request, "content-encoding") or "identity").strip().lower()
    if coding != "identity":
        raise UnsupportedMediaType(
            f"Content-Encoding {coding} is not taken; send the body as it is.", headers={"Accept-Encoding": "identity"}
        )
    if "content-range" in request.headers:
        raise BadRequest("Content-Range is not taken; send the whole body.")


def field(request: Request, name: str) -> str | None:
    """All lines of a list-valued field as one value (RFC 9110, 5.3); None when there is none."""
    return ", ".join(request.headers.getlist(name)) or None


async def read_body(request: Request) -> bytes:
    """The body, at most 64 KiB: PayloadTooLarge as soon as it is known to be more."""
    length = request.headers.get("content-length", "0")
    if length.isdecimal() and int(length) > MAX_BODY_BYTES:
        raise PayloadTooLarge(f"The body has {length} bytes; at most {MAX_BODY_BYTES} are read.")
    body = bytearray()
    async for chunk in request.stream():
        body += chunk
        if len(body) > MAX_BODY_BYTES:
            raise PayloadTooLarge(f"The body has more than {MAX_BODY_BYTES} bytes.")
    return bytes(body)


async def _answer(
    live: Live,
    invocation: Invocation,
    prefer: Prefer,
    base: str,
    representation: "Callable[[Resource], Representation]",
) -> Response:
    headers = {"location": base + invocation_path(invocation), "cache-control": "no-store", "vary": "Accept, Prefer"}
    applied, status = [], 204
    if prefer.wait_s is not None:
        applied.append(f"wait={prefer.wait_s:g}")
        if not await live.ended(invocation, prefer.wait_s):
            status = 202
    elif prefer.respond_async:
        applied.append("respond-async")
        status = 202
    body = b""
    if prefer.return_ == "representation":
        applied.append("return=representation")
        found = Tree(live.fleet, live.invocations, base).resolve(invocation_path(invocation))
        assert isinstance(found, Resource)
        shown = representation(found)
        body, headers["content-type"] = shown.body, shown.content_type
        headers["content-location"] = headers["location"]
        status = 201 if status == 204 else status
    if applied:
        headers["preference-applied"] = ", ".join(applied)
    return Response(body, status, headers)
