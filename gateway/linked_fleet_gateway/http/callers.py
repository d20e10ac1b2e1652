"""Authentication of every request: by a bearer token (RFC 6750), or by a scheme of an extension."""

from collections.abc import Sequence

from starlette.datastructures import Headers, MutableHeaders
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from linked_fleet_gateway.base.errors import FleetError, IssuerAway, StoreAway, Unauthenticated
from linked_fleet_gateway.http.authentication import Authenticated, Scheme
from linked_fleet_gateway.http.host import refuse
from linked_fleet_gateway.http.request import gateway_of
from linked_fleet_gateway.identity.jwts import BadToken
from linked_fleet_gateway.identity.rights import NOBODY, Identity
from linked_fleet_gateway.identity.service import Identities
from linked_fleet_gateway.identity.web import IssuerSilent
from linked_fleet_gateway.resources.paths import is_public, is_shared

_STARTS = ("http.response.start", "websocket.http.response.start")


class Callers:
    """ASGI middleware, inside of ``Authorities``: notes in the state of the request who asks."""

    def __init__(self, app: ASGIApp) -> None:
        self.app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        services = gateway_of(scope).services if scope["type"] in ("http", "websocket") else None
        if services is None or services.identities is None:
            await self.app(scope, receive, send)
            return
        answer = _private(scope, send)
        page = next((each for each in services.schemes if each.has_page(scope["path"])), None)
        try:
            found = await self._caller(services.identities, services.schemes, scope, free=page is not None)
            scope["state"]["authenticated"] = found
            if page is not None and scope["type"] == "http":
                response = await page.answer(scope, receive)
                await response(scope, receive, answer)
                return
        except Unauthenticated as error:
            invited = (each.invitation(scope) for each in services.schemes)
            invitation = next((each for each in invited if each is not None), None)
            if invitation is not None:
                await invitation(scope, receive, answer)
            else:
                await refuse(error, scope, answer)
            return
        except FleetError as error:
            await refuse(error, scope, answer)
            return
        await self.app(scope, receive, answer)

    async def _caller(
        self, identities: Identities, schemes: Sequence[Scheme], scope: Scope, free: bool
    ) -> Authenticated:
        """The caller. Where nobody has to be known, ``NOBODY`` if that cannot be told."""
        try:
            return await authenticate(identities, schemes, scope)
        except (Unauthenticated, StoreAway, IssuerAway):
            if not (free or is_public(scope["path"])):
                raise
            return Authenticated(NOBODY)


async def authenticate(identities: Identities, schemes: Sequence[Scheme], scope: Scope) -> Authenticated:
    """The caller; Unauthenticated, ForeignOrigin, StoreAway, IssuerAway."""
    headers = Headers(scope=scope)
    if "authorization" in headers:
        return Authenticated(await by_token(identities, headers))
    for scheme in schemes:
        found = await scheme.authenticate(scope)
        if found is not None:
            return found
    raise Unauthenticated(" ".join([*(each.hint for each in schemes), "Send Authorization: Bearer with a token."]))


async def by_token(identities: Identities, headers: Headers) -> Identity:
    """The caller by a token, which is the one way for programs; Unauthenticated, IssuerAway."""
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
    except IssuerSilent as error:
        raise IssuerAway("The keys of the issuer of this token are not known yet; try again in a moment.") from error


def _private(scope: Scope, send: Send) -> Send:
    """An answer is for the caller alone: no shared cache may keep it (RFC 9111, 5.2.2.7)."""
    if is_shared(scope["path"]):
        return send

    async def answer(message: Message) -> None:
        if message["type"] in _STARTS:
            headers = MutableHeaders(scope=message)
            stated = [each.strip() for each in headers.get("cache-control", "no-cache").split(",")]
            if "no-store" not in stated:
                headers["cache-control"] = ", ".join(["private", *(each for each in stated if each != "public")])
            varies = [each.strip() for each in headers.get("vary", "").split(",") if each.strip()]
            headers["vary"] = ", ".join(dict.fromkeys([*varies, "Authorization", "Cookie"]))
        await send(message)

    return answer
