"""Who asks: a bearer token (RFC 6750), or the session of a browser, whose requests must come from our own pages."""

from urllib.parse import quote

from starlette.datastructures import Headers, MutableHeaders
from starlette.responses import RedirectResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from gateway.base.errors import FleetError, ForeignOrigin, IssuerAway, StoreAway, Unauthenticated
from gateway.extensions.sessions.cookies import read_cookie
from gateway.extensions.sessions.login import Login
from gateway.http.host import refuse
from gateway.http.negotiation import choose
from gateway.http.representation import HTML
from gateway.http.request import Request, gateway_of
from gateway.identity.jwts import BadToken
from gateway.identity.rights import NOBODY, Identity
from gateway.identity.service import Identities
from gateway.identity.store import StoreUnavailable
from gateway.identity.web import IssuerSilent
from gateway.rdf.serialise import RDF_TYPES
from gateway.resources.paths import is_public

_READ = ("GET", "HEAD", "OPTIONS")
_STARTS = ("http.response.start", "websocket.http.response.start")
_LOGIN = "Log in at /login, or send Authorization: Bearer with a token."


class Callers:
    """ASGI middleware, inside of ``Authorities``: ``scope["state"]["caller"]`` is the identity of who asks."""

    def __init__(self, app: ASGIApp) -> None:
        self.app = app
        self._login = Login()

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        identities = gateway_of(scope).services.identities if scope["type"] in ("http", "websocket") else None
        if identities is None:
            await self.app(scope, receive, send)
            return
        answer = _private(scope, send)
        try:
            caller = await self._caller(identities, scope)
            scope["state"]["caller"] = caller
            if scope["type"] == "http" and self._login.has(scope["path"]):
                response = await self._login.answer(Request(scope, receive), identities, caller)
                await response(scope, receive, answer)
                return
        except Unauthenticated as error:
            if _would_log_in(scope):
                await _to_login(scope)(scope, receive, answer)
            else:
                await refuse(error, scope, answer)
            return
        except FleetError as error:
            await refuse(error, scope, answer)
            return
        await self.app(scope, receive, answer)

    async def _caller(self, identities: Identities, scope: Scope) -> Identity:
        """Who asks; of what needs nobody, ``NOBODY`` if that cannot be told."""
        free = is_public(scope["path"]) or self._login.has(scope["path"])
        try:
            return await authenticate(identities, scope)
        except (Unauthenticated, StoreAway, IssuerAway):
            if not free:
                raise
            return NOBODY


async def authenticate(identities: Identities, scope: Scope) -> Identity:
    """Unauthenticated, ForeignOrigin, StoreAway, IssuerAway. Notes in the state which session was used."""
    headers = Headers(scope=scope)
    if "authorization" in headers:
        return await by_token(identities, headers)
    sealed = read_cookie(scope)
    if not sealed:
        raise Unauthenticated(_LOGIN)
    _check_page(scope, headers)
    try:
        found = await identities.session(sealed)
    except StoreUnavailable as error:
        raise StoreAway("Sessions cannot be checked while Redis is away; tokens can.") from error
    if found is None:
        raise Unauthenticated(f"The session is over. {_LOGIN}", wrong=True)
    caller, scope.setdefault("state", {})["session"] = found
    return caller


async def by_token(identities: Identities, headers: Headers) -> Identity:
    """Who asks with a token, which is the one way for programs; Unauthenticated, IssuerAway."""
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


def _check_page(scope: Scope, headers: Headers) -> None:
    """ForeignOrigin for what a cookie came with and does or listens, unless a page of ours sent it.

    ``Authorities`` has refused or marked every foreign ``Origin``; here it is missed where there is none. Pages of
    other sites that may use the fleet have tokens, or whoever is logged in would act for them. Reading needs none:
    links of other sites may lead here, and what comes of it is shown to nobody but who followed them.
    """
    events = "text/event-stream" in headers.get("accept", "")
    calls_back = "callback" in headers.get("upgrade", "").lower()
    reads = scope["type"] == "http" and scope["method"] in _READ and not events and not calls_back
    elsewhere = scope["state"]["elsewhere"]
    ours = headers.get("sec-fetch-site") == "same-origin" or ("origin" in headers and not calls_back and not elsewhere)
    if not reads and not ours:
        raise ForeignOrigin("with a session this takes the Origin field of one of our pages; or send a bearer token")


def _would_log_in(scope: Scope) -> bool:
    """Whether a person waits for a page."""
    if scope["type"] != "http" or scope["method"] not in ("GET", "HEAD"):
        return False
    accept = Headers(scope=scope).get("accept")
    return accept is not None and "text/event-stream" not in accept and choose(accept, (*RDF_TYPES, HTML)) == HTML


def _to_login(scope: Scope) -> RedirectResponse:
    query = scope.get("query_string", b"").decode("latin-1")
    then = quote(scope["path"] + (f"?{query}" if query else ""), safe="")
    headers = {"cache-control": "no-store", "vary": "Accept"}
    return RedirectResponse(f"{scope['state']['base']}/login?then={then}", 303, headers)


def _private(scope: Scope, send: Send) -> Send:
    """What is answered is for who asked: no shared cache may keep it (RFC 9111, 5.2.2.7)."""
    if scope["path"].startswith("/assets/"):
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
