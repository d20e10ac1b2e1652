"""The handler of every request to a resource: methods, negotiation, ETag, Link, errors."""

import logging
import uuid
from collections.abc import Iterable, Sequence
from contextlib import suppress
from functools import partial
from urllib.parse import quote as percent

from starlette.requests import ClientDisconnect
from starlette.responses import Response
from starlette.types import ASGIApp, Receive, Scope, Send

from linked_fleet_base.errors import (
    BadRequest,
    ContainerFull,
    FleetError,
    MethodNotAllowed,
    NotFound,
    PayloadTooLarge,
    TooManyRequests,
    UnprocessableContent,
    UnsupportedMediaType,
)
from linked_fleet_gateway.http.answers import ReadyResponse
from linked_fleet_gateway.http.arrival import arrival_of
from linked_fleet_gateway.http.awaiting_stream import AwaitingStream, awaits_robot
from linked_fleet_gateway.http.callers import (
    SUBSCRIPTIONS_RIGHTS,
    require_right,
    visible_subscriptions,
    with_restricted_links,
)
from linked_fleet_gateway.http.containers import add_member, change_member
from linked_fleet_gateway.http.demands import check_demands, refuse_demands, stops
from linked_fleet_gateway.http.entrance import await_turn
from linked_fleet_gateway.http.extension import Mount, Reader, Writer
from linked_fleet_gateway.http.fields import field
from linked_fleet_gateway.http.invoke import end_invocation, invoke, put_target
from linked_fleet_gateway.http.preconditions import await_preconditions
from linked_fleet_gateway.http.problem import problem, rate_refusal
from linked_fleet_gateway.http.read import (
    READ_METHODS,
    allowed_methods,
    method_headers,
    preferred_part,
    read_interleaved,
    read_nowait,
    restrict_to_part,
)
from linked_fleet_gateway.http.request import Connection, Request, WebSocket, gateway_of
from linked_fleet_gateway.http.scheduling import may_stop
from linked_fleet_gateway.http.streams import EventStream, is_cancelled_stream, open_websocket, wants_events
from linked_fleet_gateway.http.subscribe import (
    check_handshake,
    check_upgrade,
    post_subscription,
    resume_subscription,
    subscribe_callback,
    wants_callback,
)
from linked_fleet_gateway.http.subscription_change import change_subscription
from linked_fleet_gateway.http.websocket import WebSocketHandler, serve_subprotocol
from linked_fleet_gateway.http.writes import check_interaction_model, control_lease, forget_robot, put_setting
from linked_fleet_gateway.resources.affordance import (
    ChangeSubscription,
    Control,
    Demand,
    EndInvocation,
    ForgetRobot,
    Invoke,
    PutSetting,
    PutTarget,
    ResumeSubscription,
    Subscribe,
    rights_to_read,
)
from linked_fleet_gateway.resources.branches import Branches, Found
from linked_fleet_gateway.resources.container import AddMember, ChangeMember, RemoveMember
from linked_fleet_gateway.resources.paths import owner_path, robot_of
from linked_fleet_gateway.resources.resource import Redirect, Resource
from linked_fleet_gateway.resources.subscription_resource import container_path
from linked_fleet_gateway.resources.things import NO_SUBSCRIPTIONS, SubscriptionsByOwner
from linked_fleet_gateway.subscriptions.service import Subscriptions
from linked_fleet_identity.rights import Right
from linked_fleet_server.exchange import Reply

log = logging.getLogger(__name__)

_METHODS = (*READ_METHODS, "POST", "PUT", "PATCH", "DELETE")
_LONGEST_NAMED = 200
_EMPTY_BODY = (
    " The body is empty. curl's --data '@prefix …' sends the file of that name, not the text: use --data-raw, or "
    "--data-binary @FILE for a file."
)
_CONDITIONS = frozenset({b"if-match", b"if-none-match"})


class Endpoint:
    """The ASGI application for every path and method (R0.10: a 405 has the Allow field of its own resource)."""

    def __init__(self, mounts: Iterable[Mount] = ()) -> None:
        self._readers: dict[type, Reader] = {}
        self._writers = dict(_WRITERS)
        self._websocket_handlers: dict[type, WebSocketHandler] = {}
        for mount in mounts:
            self._readers.update(mount.readers)
            self._writers.update(mount.writers)
            self._websocket_handlers.update(mount.websocket_handlers)

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] == "websocket":
            await self._upgrade(WebSocket(scope, receive, send))
            return
        reply = self.reply_nowait(scope)
        if reply is not None:
            await send({"type": "http.response.start", "status": reply.status, "headers": reply.fields})
            await send({"type": "http.response.body", "body": reply.content})
            return
        request = Request(scope, receive)
        await request.services.stop_priority.wait_unless_stop(scope)
        with suppress(ClientDisconnect):  # a client that disconnects while sending its body gets no response
            response = await self._respond(request)
            await response(scope, receive, send)

    def reply_nowait(self, scope: Scope) -> Reply | None:
        """Return the response to a GET that needs no waiting: a cached one, or one that is cached from now on.

        It is decided once for each request, by whoever asks first. An error gives None: ``__call__`` meets it again,
        and answers it.
        """
        arrival, services = arrival_of(scope), gateway_of(scope).services
        if arrival.decided:
            return None
        arrival.decided = True
        reply = services.response_cache.find(scope, services.live)
        if reply is not None:
            return reply
        try:
            if not services.response_cache.is_cacheable(scope) or _is_stored(services.live.branches, scope["path"]):
                return None
            return _read_nowait(Request(scope)) if services.stop_priority.try_take_turn() else None
        except FleetError:
            return None
        except Exception:
            # The boundary: the server has no task here that could end with an error, and ``__call__`` tries again.
            log.exception("unforeseen error in the first answer of %s", scope["path"])
            return None

    async def _respond(self, request: Request) -> ASGIApp:
        answer = await self._answered(request)
        does = wants_callback(request) or (request.method not in READ_METHODS and not request.is_safe)
        if isinstance(answer, Response) and does:
            request.report(request.method, answer.status_code, answer.headers.get("location", ""))
        return answer

    async def _answered(self, request: Request) -> ASGIApp:
        try:
            return await self._answer(request)
        except NotFound as error:
            return AwaitingStream(request, self._answer) if awaits_robot(request) else problem_response(request, error)
        except ClientDisconnect:
            raise
        except FleetError as error:
            return problem_response(request, error)
        except Exception:
            # The boundary: unexpected errors are logged completely and answered without a stack trace.
            log.exception("unforeseen error at %s %s", request.method, request.url.path)
            return problem_response(request, FleetError("The gateway failed to answer; its log has the reason."))

    async def _answer(self, request: Request) -> ASGIApp:
        if request.scope["path"] == "*" and request.method == "OPTIONS":
            return Response(status_code=204, headers={"allow": ", ".join(_METHODS)})
        check_handshake(request)
        if is_cancelled_stream(request):
            return Response(status_code=204)
        try:
            found = await self._permitted(request)
        except FleetError:
            await _count_unless_stop(request)
            raise
        if isinstance(found, Redirect):
            return _moved(request, found)
        await _count_unless_stop(request, found)
        method, is_conditional = request.method, not _CONDITIONS.isdisjoint(request.arrival.fields)
        check_upgrade(request, found)
        if method == "OPTIONS":
            return Response(status_code=204, headers=method_headers(found, allowed_methods(found)))
        if found.remote is not None and not (found.observable and (wants_events(request) or wants_callback(request))):
            if method in READ_METHODS:
                return await self._readers[type(found.remote)](request, found, found.remote)
            return await self._write(request, found)
        part = preferred_part(request, found)
        if part is not None:
            found = restrict_to_part(found, part, request.base)
        if is_conditional:
            if method in ("GET", "HEAD") and field(request, "if-match") is not None:
                await read_interleaved(
                    request, found
                )  # other refusals come before a failed precondition (RFC 9110, 13.2.1)
            await await_preconditions(request, found)
        if method not in READ_METHODS:
            if is_conditional:
                request.check_once_received(partial(_check_again, request))
            return await self._write(request, found)
        if wants_callback(request):
            require_right(request, found.path, (Right.SUBSCRIBE,))
            refuse_demands(request.arrival.fields, frozenset({Demand.PRECONDITIONS}))
            return await subscribe_callback(request, found)
        if (found.observable or found.subscription is not None) and wants_events(request):
            require_right(request, found.path, (Right.SUBSCRIBE,))
            stream = EventStream(request, found)
            await stream.register()
            return stream
        return await read_interleaved(request, found)

    async def _permitted(self, request: Request) -> Resource | Redirect:
        """Return the resource, whose method the caller may use. Raises FleetError."""
        found = await _find(request)
        if isinstance(found, Redirect) and request.method not in READ_METHODS:
            # Many clients do not follow redirects of writes, and a stop must not depend on a slash.
            _use_canonical_path(request.scope, found)
            found = await _find(request)
        request.is_safe = isinstance(found, Resource) and found.affords is not None and found.affords.reads
        if isinstance(found, Redirect):
            return found
        return _permit(request, found)

    async def _write(self, request: Request, resource: Resource) -> ASGIApp:
        """Execute a permitted write.

        If a constraint refuses it, the response links the constraints (LDP 4.2.1.6), except for queries, which are not
        representations of a resource.
        """
        try:
            check_demands(request.arrival.fields, resource)
            check_interaction_model(request, resource)
            return await self._writers[type(resource.affords)](request, resource.affords)
        except (BadRequest, ContainerFull, PayloadTooLarge, UnprocessableContent, UnsupportedMediaType) as error:
            if request.has_empty_body:
                error.detail += _EMPTY_BODY
            if not isinstance(error, BadRequest) and resource.affords is not None and not resource.affords.reads:
                error.constrain(request.base + _constraints(resource))
            raise

    async def _upgrade(self, websocket: WebSocket) -> None:
        """Open a WebSocket on a resource; refusals are HTTP responses before the handshake."""
        try:
            found = await _find(websocket)
            if isinstance(found, Resource):
                require_right(websocket, found.path, _reading(websocket, found))
                require_right(websocket, found.path, (Right.SUBSCRIBE,))
                await self._open(websocket, found)
            else:
                await websocket.send_denial_response(_moved(websocket, found))
        except FleetError as error:
            await websocket.send_denial_response(problem_response(websocket, error))

    async def _open(self, websocket: WebSocket, resource: Resource) -> None:
        for value in (resource.remote, resource.affords):
            handler = self._websocket_handlers.get(type(value))
            if handler is not None and handler.serves(value):
                if value is not resource.remote and resource.affords is not None:
                    require_right(websocket, resource.path, resource.affords.needs)
                await serve_subprotocol(websocket, resource, handler, value)
                return
        await open_websocket(websocket, resource)


async def _count_unless_stop(request: Request, resource: Resource | None = None) -> None:
    """Count a request whose path looks like that of a stop, unless it is one. Raises TooManyRequests."""
    if may_stop(request.scope) and not request.arrival.internal and (resource is None or not stops(resource)):
        await await_turn(request)


async def _check_again(request: Request) -> None:
    """Check the preconditions once more, because the resource may have changed while its body arrived."""
    found = await _find(request)
    if isinstance(found, Resource):
        await await_preconditions(request, with_restricted_links(request, found))


def _use_canonical_path(scope: Scope, to: Redirect) -> None:
    raw: bytes = scope["raw_path"]
    scope["path"], scope["raw_path"] = to.path, raw + b"/" if to.path.endswith("/") else raw.removesuffix(b"/")


def _needed(request: Request, resource: Resource) -> Sequence[Right]:
    affords = resource.affords
    if affords is not None and request.method in affords.methods:
        return affords.needs
    return SUBSCRIPTIONS_RIGHTS if isinstance(affords, Subscribe) else _reading(request, resource)


def _reading(connection: Connection, resource: Resource) -> Sequence[Right]:
    """Return the rights, one of which is needed to read the resource."""
    return connection.services.live.branches.reading(resource.path) or rights_to_read(resource.affords)


def _permit(request: Request, found: Resource) -> Resource:
    """Return the resource as the caller sees it, if the caller may use the method. Raises FleetError."""
    if request.method in READ_METHODS or request.is_safe or not _CONDITIONS.isdisjoint(request.arrival.fields):
        found = with_restricted_links(request, found)  # preconditions are about what the caller reads
    # Rights are checked before methods, so that a 405 never reveals what is possible to callers without rights.
    require_right(request, found.path, _needed(request, found))
    if request.method not in (allow := allowed_methods(found)):
        raise MethodNotAllowed(f"{request.method} is not possible here; {', '.join(allow)} are.", allow=allow)
    return found


def _read_nowait(request: Request) -> Reply | None:
    """Return the response to a GET of a resource that is not stored; None if it takes long or is not cached.

    Pages alone show the reader. They take long.
    """
    found = _resolve(request)
    if not isinstance(found, Resource) or found.remote is not None:
        return None
    return read_nowait(request, _permit(request, found))


async def _find(connection: Connection) -> Resource | Redirect:
    """Find the resource of the request. Raises NotFound, BadRequest, RedisUnavailable."""
    path: str = connection.scope["path"]
    if (branch := connection.services.live.branches.stored_branch(path)) is not None:
        assert branch.load is not None
        require_right(connection, path, branch.reading or (Right.READ,))
        return await branch.load(connection.tree().view, path.split("/")[2:])
    shows_subscriptions = "/subscriptions" in path
    return _resolve(
        connection, await _subscriptions_shown(connection, path) if shows_subscriptions else NO_SUBSCRIPTIONS
    )


def _resolve(connection: Connection, subscriptions: SubscriptionsByOwner = NO_SUBSCRIPTIONS) -> Resource | Redirect:
    """Find a resource that is not stored, or shows the ``subscriptions``. Raises NotFound, BadRequest."""
    path: str = connection.scope["path"]
    if not path.startswith("/"):
        raise BadRequest(f"The request target is no path, such as /, and no URL below {connection.base}/.")
    # An encoded slash is no separator (RFC 3986, 2.2). Names in the tree contain none, but ids of things do.
    encoded = b"%2f" in connection.scope["raw_path"].lower()
    lost = encoded and not connection.services.live.branches.allows_encoded_slashes(path)
    found: Found = None if lost else connection.tree(subscriptions).resolve(path)
    if found is None:
        raise NotFound(f"There is no resource at {path[:_LONGEST_NAMED]}; browse from {connection.base}/.")
    return found


def _is_stored(branches: Branches, path: str) -> bool:
    """Return True for a path of what Redis has: branches that are read from a store, and subscriptions."""
    return branches.stored_branch(path) is not None or path.startswith(container_path(owner_path(path)))


async def _subscriptions_shown(connection: Connection, path: str) -> SubscriptionsByOwner:
    """Return the subscriptions that the resource at ``path`` shows, if any."""
    owner = owner_path(path)
    head, _, rest = path.removeprefix(container_path(owner)).partition("/")
    robot = robot_of(owner)
    if head or not path.startswith(container_path(owner)) or not connection.caller.has_right(Right.READ, robot):
        return NO_SUBSCRIPTIONS
    subscriptions: Subscriptions = connection.services.subscriptions
    if not rest:
        return {owner: visible_subscriptions(connection, await subscriptions.records_of_owner(owner), owner)}
    id = _uuid(rest.partition("/")[0])
    record = None if id is None else await subscriptions.get_record(id)
    if record is None or record.subscription.owner != owner:
        return NO_SUBSCRIPTIONS
    return {owner: visible_subscriptions(connection, [record], owner)}


def _uuid(text: str) -> str | None:
    """Return the text if it is a UUID in canonical form; other texts never become part of a Redis key."""
    try:
        return text if str(uuid.UUID(text)) == text else None
    except ValueError:
        return None


def _moved(connection: Connection, to: Redirect) -> Response:
    query = f"?{connection.url.query}" if connection.url.query else ""
    return Response(status_code=308, headers={"location": connection.base + to.path + query})


def _constraints(resource: Resource) -> str:
    """Return the path of the constraints of the resource's bodies: the description of an action, else the blueprint."""
    blueprint = resource.path.rstrip("/") + "/blueprint"
    return blueprint if blueprint in resource.own_paths else resource.path


_WRITERS: dict[type, Writer] = {
    Invoke: invoke,
    EndInvocation: end_invocation,
    PutTarget: put_target,
    PutSetting: put_setting,
    Control: control_lease,
    ForgetRobot: forget_robot,
    Subscribe: post_subscription,
    ChangeSubscription: change_subscription,
    ResumeSubscription: resume_subscription,
    AddMember: add_member,
    ChangeMember: change_member,
    RemoveMember: change_member,
}


def problem_response(request: Connection, error: FleetError) -> Response:
    """Return problem details for ``error`` in the form that Accept prefers; JSON for a refusal by rate."""
    request.refusal = error.detail
    if isinstance(error, TooManyRequests):
        return ReadyResponse(rate_refusal(error.wait_s))
    path = percent(request.scope["path"], safe="/~")
    instance = request.base + path if len(path) <= _LONGEST_NAMED else None
    reader = partial(request.reader, request.scope["path"])
    body, headers = problem(error, field(request, "accept"), instance, request.services.representations.html, reader)
    # HEAD has the headers of GET including Content-Length; the server leaves out the body.
    return Response(body, error.status, headers)
