"""The one place that every resource passes through: methods, negotiation, ETag, Link, errors (DESIGN "HTTP")."""

import logging
import uuid
from collections.abc import Awaitable, Callable, Sequence
from contextlib import suppress
from dataclasses import replace
from typing import Any
from urllib.parse import quote as percent

from starlette.requests import ClientDisconnect, HTTPConnection, Request
from starlette.responses import Response
from starlette.types import ASGIApp, Receive, Scope, Send
from starlette.websockets import WebSocket

from gateway.base.errors import (
    BadRequest,
    FleetError,
    MethodNotAllowed,
    NoRoom,
    NotAcceptable,
    NotFound,
    PayloadTooLarge,
    PreconditionFailed,
    UnprocessableContent,
    UnsupportedMediaType,
)
from gateway.extensions.cameras.http import picture, picture_type
from gateway.extensions.cameras.resources import Eye
from gateway.extensions.history.http import read_past
from gateway.extensions.history.resources import Past
from gateway.extensions.pages.policy import FORMS, POLICY
from gateway.extensions.query.description import Endpoint, PostQuery
from gateway.extensions.query.http import QUERY_TYPES, is_query, post_query, read_query
from gateway.extensions.rules.description import ChangeRule, MakeRule
from gateway.extensions.rules.http import change_rule, post_rule
from gateway.extensions.things.directory import Listing
from gateway.extensions.things.documents import DIRECTORY
from gateway.extensions.things.http import read_listing
from gateway.extensions.world.http import posed, post_object, put_object
from gateway.extensions.world.resources import AskPose, PostObject, PutObject
from gateway.http.audit import NEEDS as AUDIT_NEEDS
from gateway.http.audit import audit_resource, is_audit, note, with_audit
from gateway.http.body import BODY_TYPES, FORM_TYPES
from gateway.http.conditional import not_modified, precondition_holds
from gateway.http.containers import preferred_part, shown_part
from gateway.http.control import control, put_setting
from gateway.http.fields import field
from gateway.http.health import store_warning
from gateway.http.invoke import end_invocation, invoke, put_target
from gateway.http.links import Link, link_header
from gateway.http.models import check_model
from gateway.http.negotiation import choose
from gateway.http.patch import PATCH_TYPES
from gateway.http.preconditions import await_preconditions, check_preconditions
from gateway.http.problem import problem
from gateway.http.repeatable import offer_repeat
from gateway.http.representation import negotiated, preferred
from gateway.http.rights import SEES_SUBSCRIPTIONS, caller_of, demand, shown, tree_of
from gateway.http.stop_priority import Turns
from gateway.http.streams import EventStream, is_over, open_websocket, wants_events
from gateway.http.subscribe import (
    check_handshake,
    post_subscription,
    refusals,
    resume,
    subscribe_callback,
    wants_callback,
)
from gateway.http.subscription_change import change_subscription
from gateway.identity.rights import Right
from gateway.rdf.vocabulary import PREFIXES
from gateway.resources.affordance import (
    Affordance,
    ChangeSubscription,
    Control,
    EndInvocation,
    Invoke,
    PutSetting,
    PutTarget,
    ResumeSubscription,
    Subscribe,
)
from gateway.resources.extension import Found
from gateway.resources.paths import is_below, owner_path, robot_of
from gateway.resources.resource import CONTAINER, Redirect, Remote, Resource
from gateway.resources.subscription_resource import container_path
from gateway.resources.tree import EMPTY, Shelf
from gateway.subscriptions.live import Live
from gateway.subscriptions.service import Subscriptions

log = logging.getLogger(__name__)

# The whole header block stays under 4 KiB, and Link is not alone in it.
_LINK_BYTES = 3584
_READ = ("GET", "HEAD", "OPTIONS")
_METHODS = (*_READ, "POST", "PUT", "PATCH", "DELETE")
_LONGEST_NAMED = 200
# Foreign XML and meshes: should a browser take one for a document, it is one that can do nothing.
_NOTHING = "sandbox; default-src 'none'"
_FOR_EVER = "public, max-age=31536000, immutable"


async def resources(scope: Scope, receive: Receive, send: Send) -> None:
    """The ASGI application for every path and every method (R0.10: a 405 carries the Allow of its own resource)."""
    if scope["type"] == "websocket":
        await _upgrade(WebSocket(scope, receive, send))
        return
    request = Request(scope, receive)
    turns: Turns = request.app.state.turns
    await turns.turn(scope)
    with suppress(ClientDisconnect):  # who left in the middle of a body is answered nothing, and is no fault of ours
        response = await _respond(request)
        await response(scope, receive, send)


async def _upgrade(websocket: WebSocket) -> None:
    """A WebSocket on a resource; what speaks against it is answered in HTTP, before any handshake."""
    base: str = websocket.state.base
    try:
        found = await _find(websocket, base)
        if isinstance(found, Resource):
            demand(websocket, found.path, (Right.READ,))
            demand(websocket, found.path, (Right.SUBSCRIBE,))
            await open_websocket(websocket, found, base)
        else:
            await websocket.send_denial_response(_moved(websocket, found, base))
    except FleetError as error:
        await websocket.send_denial_response(problem_response(websocket, error))


async def _respond(request: Request) -> ASGIApp:
    answer = await _answered(request)
    does = wants_callback(request) or (request.method not in _READ and not is_query(request))
    if isinstance(answer, Response) and does:
        note(request, request.method, answer.status_code, answer.headers.get("location", ""))
    return answer


async def _answered(request: Request) -> ASGIApp:
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


async def _answer(request: Request, base: str) -> ASGIApp:
    if request.scope["path"] == "*" and request.method == "OPTIONS":
        return Response(status_code=204, headers={"allow": ", ".join(_METHODS)})
    check_handshake(request)
    if is_over(request):
        return Response(status_code=204)
    found = await _find(request, base)
    if isinstance(found, Redirect):
        return _moved(request, found, base)
    allow = _allow(found)
    # What must not be done is refused before what cannot be done: a refusal by method would tell what can.
    demand(request, found.path, _needed(request, found))
    if request.method not in allow:
        raise MethodNotAllowed(f"{request.method} is not possible here; {', '.join(allow)} are.", allow=allow)
    if request.method == "OPTIONS":
        return Response(status_code=204, headers=_options(found, allow))
    if found.remote is not None and not (found.observable and (wants_events(request) or wants_callback(request))):
        if request.method in _READ:
            return await _READERS[type(found.remote)](request, found, found.remote, base)
        return await _write(request, found, base)
    part = preferred_part(request, found)
    if part is not None:
        found = shown_part(found, part, base)
    await await_preconditions(request, found, base)
    if request.method not in _READ:
        return await _write(request, found, base)
    if wants_callback(request):
        demand(request, found.path, (Right.SUBSCRIBE,))
        return await subscribe_callback(request, found, base)
    if (found.observable or found.subscription is not None) and wants_events(request):
        demand(request, found.path, (Right.SUBSCRIBE,))
        stream = EventStream(request, found, base)
        await stream.register()
        return stream
    return _read(request, found, base)


def _needed(request: Request, resource: Resource) -> Sequence[Right]:
    if is_audit(resource.path):
        return AUDIT_NEEDS
    affords = resource.affords
    if affords is not None and request.method in affords.methods:
        return affords.needs
    return SEES_SUBSCRIPTIONS if isinstance(affords, Subscribe) else (Right.READ,)


async def _find(connection: HTTPConnection, base: str) -> Resource | Redirect:
    """What the request is about; NotFound, BadRequest, StoreAway."""
    path: str = connection.scope["path"]
    if not path.startswith("/"):
        raise BadRequest(f"The request target is no path, such as /, and no URL below {base}/.")
    if is_audit(path):
        demand(connection, path, AUDIT_NEEDS)
        return await audit_resource(connection, base)
    # An encoded slash separates nothing (RFC 3986, 2.2), and no name in the tree has one, but the ids of things have.
    encoded_slash = b"%2f" in connection.scope["raw_path"].lower() and not is_below(path, DIRECTORY)
    found: Found = None if encoded_slash else tree_of(connection, base, await _shelf(connection, path)).resolve(path)
    if found is None:
        raise NotFound(f"There is no resource at {path[:_LONGEST_NAMED]}; browse from {base}/.")
    if isinstance(found, Redirect):
        return found
    if getattr(connection.state, "session", None):
        found = replace(found, reader=caller_of(connection).name)
    if not caller_of(connection).may_any(SEES_SUBSCRIPTIONS, robot_of(found.path)):
        found = replace(found, links_subscriptions=False)
    if warning := store_warning(connection.app.state):
        found = replace(found, warning=warning)
    return with_audit(connection, found)


async def _shelf(connection: HTTPConnection, path: str) -> Shelf:
    """The subscriptions that the resource at ``path`` is about, if it is about any."""
    owner = owner_path(path)
    head, _, rest = path.removeprefix(container_path(owner)).partition("/")
    robot = robot_of(owner)
    if head or not path.startswith(container_path(owner)) or not caller_of(connection).may(Right.READ, robot):
        return EMPTY
    subscriptions: Subscriptions = connection.app.state.subscriptions
    async with refusals():
        if not rest:
            return {owner: shown(connection, await subscriptions.of(owner), owner)}
        id = _uuid(rest.partition("/")[0])
        record = None if id is None else await subscriptions.record(id)
        if record is None or record.subscription.owner != owner:
            return EMPTY
        return {owner: shown(connection, [record], owner)}


def _uuid(text: str) -> str | None:
    """The text, if it is a UUID as we write it: nothing else ever becomes part of a key of the store."""
    try:
        return text if str(uuid.UUID(text)) == text else None
    except ValueError:
        return None


def _moved(connection: HTTPConnection, to: Redirect, base: str) -> Response:
    query = f"?{connection.url.query}" if connection.url.query else ""
    return Response(status_code=308, headers={"location": base + to.path + query})


async def _write(request: Request, resource: Resource, base: str) -> Response:
    """Carry out an allowed write. A refusal by a constraint links the constraints (LDP 4.2.1.6), but not those on
    queries, which are no representation of anything."""
    try:
        check_model(request, resource)
        return await _WRITERS[type(resource.affords)](request, resource.affords, base)
    except (NoRoom, PayloadTooLarge, UnprocessableContent, UnsupportedMediaType) as error:
        if not isinstance(resource.affords, PostQuery):
            error.constrain(base + _constraints(resource))
        raise


def _constraints(resource: Resource) -> str:
    """Path of what says which bodies the resource takes: the shape in an action's description, else the blueprint."""
    blueprint = resource.path.rstrip("/") + "/blueprint"
    return blueprint if blueprint in resource.own else resource.path


_WRITERS: dict[type, Callable[[Request, Any, str], Awaitable[Response]]] = {
    Invoke: invoke,
    EndInvocation: end_invocation,
    PutTarget: put_target,
    PutSetting: put_setting,
    Control: control,
    Subscribe: post_subscription,
    ChangeSubscription: change_subscription,
    ResumeSubscription: resume,
    PostObject: post_object,
    PutObject: put_object,
    MakeRule: post_rule,
    ChangeRule: change_rule,
    PostQuery: post_query,
}


def problem_response(request: HTTPConnection, error: FleetError) -> Response:
    """Problem details for ``error`` in the form that Accept asks for."""
    path = percent(request.scope["path"], safe="/~")
    instance = request.state.base + path if len(path) <= _LONGEST_NAMED else None
    body, headers = problem(error, field(request, "accept"), instance, PREFIXES)
    # HEAD has the headers of GET, its Content-Length too; the server itself leaves the body out.
    return Response(body, error.status, headers)


def _read(request: Request, resource: Resource, base: str) -> Response:
    accept = preferred(field(request, "accept"), request.query_params.get("as"))
    representation = negotiated(accept, resource, base)
    offer_repeat(request, resource, representation.media_type, base)
    headers = _headers(resource, base, representation.etag)
    if representation.media_type not in resource.documents and preferred_part(request, resource) is not None:
        headers["preference-applied"] = "return=representation"
    if representation.media_type == "text/html":
        headers["content-security-policy"] = FORMS if resource.reader or resource.forms else POLICY
    elif representation.media_type.endswith("xml"):
        headers["content-security-policy"] = _NOTHING
    if not_modified(field(request, "if-none-match"), representation.etag):
        return Response(status_code=304, headers=headers)
    headers["content-type"] = representation.content_type
    headers |= _options(resource, _allow(resource))
    # Starlette computes Content-Length from the body; the server itself leaves the body of a HEAD out.
    return Response(representation.body, headers=headers)


async def _read_mesh(request: Request, resource: Resource, remote: Remote, base: str) -> Response:
    """Only who gets the bytes has the robot asked for them: size and digest are known."""
    mesh = remote.mesh
    etag = f'"{mesh.sha256}"'
    if choose(field(request, "accept"), (mesh.type,)) is None:
        raise NotAcceptable(f"Available here: {mesh.type}.", offered=(mesh.type,))
    if not precondition_holds(field(request, "if-match"), {etag}):
        raise PreconditionFailed(f"The entity tag of this mesh is {etag}.")
    headers = _headers(resource, base, etag) | {"content-security-policy": _NOTHING}
    if not_modified(field(request, "if-none-match"), etag):
        return Response(status_code=304, headers=headers)
    headers |= {"content-type": mesh.type, "content-length": str(mesh.size)} | _options(resource, _allow(resource))
    live: Live = request.app.state.live
    content = b"" if request.method == "HEAD" else await live.meshes.get(remote.robot, mesh)
    return Response(content, headers=headers)


async def _read_camera(request: Request, resource: Resource, eye: Eye, base: str) -> Response:
    """RDF as of any resource, or what the camera sees."""
    media_type = picture_type(request, resource)
    if media_type is not None:
        return await picture(request, eye, media_type, _headers(resource, base, "") | _options(resource, _READ))
    await await_preconditions(request, resource, base)
    return _read(request, resource, base)


async def _read_pose(request: Request, resource: Resource, asked: AskPose, base: str) -> Response:
    return _read(request, posed(request, resource, asked, base), base)


async def _read_past(request: Request, _: Resource, past: Past, base: str) -> Response:
    def read(resource: Resource) -> Response:
        check_preconditions(request, resource, base)
        return _read(request, resource, base)

    return await read_past(request, past, read)


async def _read_query(request: Request, resource: Resource, endpoint: Endpoint, base: str) -> Response:
    """The answer to a query, or RDF as of any resource."""
    answer = await read_query(request, endpoint, base)
    if isinstance(answer, Response):
        return answer
    described = replace(answer, reader=resource.reader, warning=resource.warning)
    await await_preconditions(request, described, base)
    return _read(request, described, base)


_READERS: dict[type, Callable[[Request, Resource, Any, str], Awaitable[Response]]] = {
    Remote: _read_mesh,
    Eye: _read_camera,
    Listing: read_listing,
    AskPose: _read_pose,
    Past: _read_past,
    Endpoint: _read_query,
}


def _headers(resource: Resource, base: str, etag: str) -> dict[str, str]:
    headers = {
        "etag": etag,
        "vary": "Accept, Prefer" if resource.interaction == CONTAINER else "Accept",
        "cache-control": _FOR_EVER if resource.immutable else "no-cache",
        "x-content-type-options": "nosniff",
    }
    link = _link(resource, base)
    return headers | {"link": link} if link else headers


def _allow(resource: Resource) -> tuple[str, ...]:
    return _READ if resource.affords is None else (*_READ, *resource.affords.methods)


def _options(resource: Resource, allow: tuple[str, ...]) -> dict[str, str]:
    headers = {"allow": ", ".join(allow)}
    if resource.affords is not None and (taken := _taken(resource.affords)):
        fields = {"POST": "accept-post", "PUT": "accept-put"}
        headers |= {fields[method]: ", ".join(taken) for method in allow if method in fields}
        headers |= {"accept-patch": ", ".join(PATCH_TYPES)} if "PATCH" in allow else {}
    return headers


def _taken(affords: Affordance) -> Sequence[str]:
    """Media types of a body; JSON where a shape says what the members of an object would mean."""
    if isinstance(affords, PostQuery):
        return QUERY_TYPES
    if not affords.takes_body:
        return ()
    shaped = isinstance(affords, Invoke | PutTarget)
    if isinstance(affords, PutSetting):
        shaped = affords.setting.shape is not None
    return FORM_TYPES if shaped else BODY_TYPES


def _link(resource: Resource, base: str) -> str:
    types = [Link(iri.value, "type") for iri in resource.interaction]
    layout = [] if resource.layout is None else [Link(base + resource.layout, "describedby")]
    own = types + layout + [Link(base + path, "related") for path in resource.own]
    parts = [Link(base + path, "related") for path in resource.parts]
    linkset = base + resource.linkset if resource.has_linkset else None
    return link_header(own, parts, linkset, limit=_LINK_BYTES)
