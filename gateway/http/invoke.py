"""Invoking an action: body → typed quantity → command → answer (flow "action"; R0.7, R0.8, RFC 7240)."""

from starlette.requests import Request
from starlette.responses import Response

from gateway.errors import AgentSilent
from gateway.fleet.invocations import Invocation
from gateway.graph.actions import JointMotion
from gateway.graph.guard import admit
from gateway.graph.invocation import invocation_path
from gateway.graph.resource import Resource
from gateway.graph.tree import Tree
from gateway.http.body import body_type, read_triples
from gateway.http.fields import field
from gateway.http.prefer import Prefer, parse_prefer
from gateway.http.representation import Representation, negotiated
from gateway.live import Live


async def invoke(request: Request, action: JointMotion, live: Live, base: str) -> Response:
    """204 with Location; 201 with the invocation by Prefer: return=representation, 202 by respond-async or wait."""
    media_type = body_type(request)
    prefer, tree = parse_prefer(field(request, "prefer")), live.tree(base)
    if prefer.return_ == "representation":
        # As negotiable as the invocation will be: a 406 comes before the motion or never.
        _show(request, tree, action.path, base)
    iri = base + action.path
    triples = await read_triples(request, media_type, iri, base)
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
