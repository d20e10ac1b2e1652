"""Invoking an action: body → typed quantity → command → answer (flow "action"; R0.7, R0.8, RFC 7240)."""

from starlette.requests import Request
from starlette.responses import Response

from gateway.errors import AgentSilent, BadRequest, PayloadTooLarge, UnsupportedMediaType
from gateway.fleet.invocations import Invocation
from gateway.graph.actions import JointMotion
from gateway.graph.guard import admit
from gateway.graph.invocation import invocation_path
from gateway.graph.serialise import ParseError, parse
from gateway.graph.tree import Resource, Tree
from gateway.graph.vocab import PREFIXES
from gateway.http.fields import field
from gateway.http.negotiation import parse_content_type
from gateway.http.prefer import Prefer, parse_prefer
from gateway.http.representation import Representation, negotiated
from gateway.live import Live

BODY_TYPES = ("text/turtle", "application/ld+json", "application/n-triples", "application/rdf+xml")
MAX_BODY_BYTES = 64 * 1024
_CONTEXT = "https://w3id.org/linked-fleet/context"


async def invoke(request: Request, action: JointMotion, live: Live, base: str) -> Response:
    """204 with Location; 201 with the invocation by Prefer: return=representation, 202 by respond-async or wait."""
    media_type, _ = parse_content_type(field(request, "content-type"), BODY_TYPES)
    _check_whole(request)
    prefer, tree = parse_prefer(field(request, "prefer")), Tree(live.fleet, live.invocations, base)
    if prefer.return_ == "representation":
        # As negotiable as the invocation will be: a 406 comes before the motion or never.
        _show(request, tree, action.path, base)
    body = await read_body(request)
    iri = base + action.path
    context = {"@context": PREFIXES}
    try:
        triples = parse(body, media_type, iri, contexts={_CONTEXT: context, f"{base}/context": context})
    except ParseError as error:
        raise BadRequest(f"The body is no {media_type}: {error}", line=error.line, column=error.column) from error
    quantity = admit(triples, action.joint, iri)
    try:
        invocation = await live.invoke(action.robot, action.path, action.motion(quantity.value, quantity.unit))
    except AgentSilent as error:
        error.headers["location"] = base + error.headers["location"]
        raise
    status, applied = await _outcome(live, invocation, prefer)
    location = base + invocation_path(invocation)
    headers = {"location": location, "cache-control": "no-store", "vary": "Accept, Prefer"}
    content = b""
    if prefer.return_ == "representation":
        applied.append("return=representation")
        shown = _show(request, tree, invocation_path(invocation), base)
        content, status = shown.body, 201 if status == 204 else status
        headers |= {"content-type": shown.content_type, "content-location": location}
    if applied:
        headers["preference-applied"] = ", ".join(applied)
    return Response(content, status, headers)


def _show(request: Request, tree: Tree, path: str, base: str) -> Representation:
    found = tree.resolve(path)
    assert isinstance(found, Resource)
    return negotiated(field(request, "accept"), found, base)


async def _outcome(live: Live, invocation: Invocation, prefer: Prefer) -> tuple[int, list[str]]:
    """Status and the preferences that were followed; 202 when the motion may still go on."""
    if prefer.wait_s is not None:
        ended = await live.ended(invocation, prefer.wait_s)
        return 204 if ended else 202, [f"wait={prefer.wait_s:g}"]
    if prefer.respond_async:
        return 202, ["respond-async"]
    return 204, []


def _check_whole(request: Request) -> None:
    """The content itself, neither compressed (RFC 9110, 8.4 and 15.5.16) nor a part of it (14.5)."""
    coding = (field(request, "content-encoding") or "identity").strip().lower()
    if coding != "identity":
        raise UnsupportedMediaType(
            f"Content-Encoding {coding} is not taken; send the body as it is.", headers={"Accept-Encoding": "identity"}
        )
    if "content-range" in request.headers:
        raise BadRequest("Content-Range is not taken; send the whole body.")


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
