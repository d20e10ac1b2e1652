"""The caller of every request: authentication, and checks of rights.

A bearer token (RFC 6750) or a scheme of an extension authenticates the request.
"""

from collections.abc import Sequence

from starlette.datastructures import Headers, MutableHeaders
from starlette.types import Message, Receive, Scope, Send

from linked_fleet_base.errors import (
    FleetError,
    InsufficientScope,
    IssuerDown,
    RedisUnavailable,
    Unauthenticated,
)
from linked_fleet_gateway.http.arrival import Arrival, Authenticated, Scheme, arrival_of
from linked_fleet_gateway.http.demands import refuse_demands
from linked_fleet_gateway.http.forwarding import send_problem
from linked_fleet_gateway.http.request import Connection, Request
from linked_fleet_gateway.resources.affordance import NOTHING
from linked_fleet_gateway.resources.paths import is_public, is_shared, robot_of
from linked_fleet_gateway.resources.resource import Resource
from linked_fleet_gateway.resources.subscription import Depth, Record
from linked_fleet_identity.issuers import BadToken, IssuerFailed
from linked_fleet_identity.rights import NOBODY, Identity, Right
from linked_fleet_identity.service import Identities

_SHARING = ("private", "public")
_STARTS = ("http.response.start", "websocket.http.response.start")


def identify_static_token(identities: Identities, arrival: Arrival) -> bool:
    """Store the caller of a token that can be judged without waiting; return False for other credentials."""
    scheme, _, token = arrival.fields.get(b"authorization", b"").decode("latin-1").partition(" ")
    found = identities.static_token_identity(token.strip()) if scheme.lower() == "bearer" else None
    if found is None:
        return False
    arrival.authenticated = Authenticated(found)
    return True


async def identify(
    identities: Identities, schemes: Sequence[Scheme], scope: Scope, receive: Receive, send: Send
) -> Send | None:
    """Store the caller, and return the function that sends the response.

    Returns None if the request is answered already: by a refusal, a redirect to the login, or a page of a scheme.
    """
    answer = _private(scope, send)
    page = next((each for each in schemes if each.has_page(scope["path"])), None)
    try:
        found = await _caller(identities, schemes, scope, free=page is not None)
        arrival_of(scope).authenticated = found
        if page is not None and scope["type"] == "http":
            if scope["method"] not in ("GET", "HEAD", "OPTIONS"):
                refuse_demands(arrival_of(scope).fields, NOTHING)
            response = await page.answer(scope, receive)
            await response(scope, receive, answer)
            return None
    except Unauthenticated as error:
        invited = (each.login_response(scope) for each in schemes)
        login = next((each for each in invited if each is not None), None)
        if login is not None:
            await login(scope, receive, answer)
        else:
            await send_problem(error, scope, answer)
        return None
    except FleetError as error:
        await send_problem(error, scope, answer)
        return None
    return answer


async def _caller(identities: Identities, schemes: Sequence[Scheme], scope: Scope, free: bool) -> Authenticated:
    """Return the caller. If authentication is optional, return ``NOBODY`` if the caller cannot be determined."""
    try:
        return await authenticate(identities, schemes, scope)
    except (Unauthenticated, RedisUnavailable, IssuerDown):
        if not (free or is_public(scope["path"])):
            raise
        return Authenticated(NOBODY)


async def authenticate(identities: Identities, schemes: Sequence[Scheme], scope: Scope) -> Authenticated:
    """Return the caller. Raises Unauthenticated, ForeignOrigin, RedisUnavailable, IssuerDown."""
    headers = Headers(scope=scope)
    if "authorization" in headers:
        return Authenticated(await identify_bearer(identities, headers))
    for scheme in schemes:
        found = await scheme.authenticate(scope)
        if found is not None:
            return found
    raise Unauthenticated(" ".join([*(each.hint for each in schemes), "Send Authorization: Bearer with a token."]))


async def identify_bearer(identities: Identities, headers: Headers) -> Identity:
    """Return the caller of a bearer token. Raises Unauthenticated, IssuerDown."""
    said = headers.getlist("authorization")
    if not said:
        raise Unauthenticated("Send Authorization: Bearer with a token.")
    scheme, _, token = said[0].partition(" ")
    if len(said) != 1 or scheme.lower() != "bearer" or not token.strip():
        raise Unauthenticated("Authorization is Bearer and one token.", wrong=True)
    try:
        return await identities.bearer(token.strip())
    except BadToken as error:
        raise Unauthenticated(f"The token is not accepted: {error}.", wrong=True) from error
    except IssuerFailed as error:
        raise IssuerDown("The keys of the issuer of this token are not known yet; try again in a moment.") from error


def mark_private(path: str, headers: MutableHeaders) -> None:
    """Mark a response as private, so that no shared cache stores it (RFC 9111, 5.2.2.7). May be repeated."""
    if is_shared(path):
        return
    stated = [each.strip() for each in headers.get("cache-control", "no-cache").split(",")]
    if "no-store" not in stated:
        headers["cache-control"] = ", ".join(["private", *(each for each in stated if each not in _SHARING)])
    varies = [each.strip() for each in headers.get("vary", "").split(",") if each.strip()]
    headers["vary"] = ", ".join(dict.fromkeys([*varies, "Authorization", "Cookie"]))


def _private(scope: Scope, send: Send) -> Send:
    async def answer(message: Message) -> None:
        if message["type"] in _STARTS:
            mark_private(scope["path"], MutableHeaders(scope=message))
        await send(message)

    return answer


SUBSCRIPTIONS_RIGHTS = (Right.SUBSCRIBE, Right.ADMIN)
"""Rights, one of which is needed to read a Subscriptions container: ``subscribe`` for one's own, ``admin`` for all."""


def require_right(connection: Connection, path: str, scopes: Sequence[Right]) -> None:
    """Raise InsufficientScope unless the caller has one of ``scopes`` on the resource at ``path``."""
    if is_public(path) or connection.caller.has_any_right(scopes, robot_of(path)):
        return
    wanted = " or ".join(scopes)
    raise InsufficientScope(f"This takes the right to {wanted} here, which you do not have.", scope=scopes[0])


def require_subtree(connection: Connection, path: str, depth: Depth) -> None:
    """Raise InsufficientScope for the subtree of the fleet unless the caller may subscribe to all that it reads."""
    caller = connection.caller
    if (
        path == "/"
        and depth is Depth.SUBTREE
        and not caller.view_for(Right.SUBSCRIBE).is_superset_of(caller.visible_robots)
    ):
        raise InsufficientScope("You may read robots that you may not subscribe to.", scope=Right.SUBSCRIBE)


def visible_subscriptions(connection: Connection, records: Sequence[Record], owner: str) -> list[Record]:
    """Return the visible subscriptions of a thing: the caller's own with ``subscribe``, all of them with ``admin``."""
    caller, robot = connection.caller, robot_of(owner)
    if caller.has_right(Right.ADMIN, robot):
        return list(records)
    if not caller.has_right(Right.SUBSCRIBE, robot):
        return []
    return [each for each in records if caller.name and each.subscription.creator == caller.name]


def with_restricted_links(request: Request, resource: Resource) -> Resource:
    """Add links to the restricted branches that the caller may read to the fleet and its link set.

    The RDF does not contain the links, because it is equal for all callers with the same view, like messages about it.
    """
    fleet = resource if resource.linkset_of is None else resource.linkset_of
    if fleet.path != "/" or not (paths := request.restricted_paths):
        return resource
    fleet = fleet.replace(own_paths=(*fleet.own_paths, *paths))
    return fleet if resource.linkset_of is None else resource.replace(linkset_of=fleet)
