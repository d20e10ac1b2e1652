"""The pages for login and logout: by a token, or at an issuer (OpenID Connect, code flow with PKCE).

The error of logins is ``TooManyLogins`` (429, too-many-logins).
"""

# ruff: noqa: N818  (the names say what is wrong, as those of linked_fleet_base.errors)

import logging
import math
import secrets
import time
from base64 import urlsafe_b64encode
from collections.abc import Sequence
from hashlib import sha256
from hmac import compare_digest
from typing import Any
from urllib.parse import parse_qs, quote, urlencode

from starlette.responses import RedirectResponse, Response

from linked_fleet_base.errors import (
    BadRequest,
    FleetError,
    ForeignOrigin,
    IssuerDown,
    MethodNotAllowed,
    NotFound,
)
from linked_fleet_gateway.api import Request, Right
from linked_fleet_gateway.extensions.pages.languages import language, message, say, speaking, translated
from linked_fleet_gateway.extensions.pages.page import FORMS, render
from linked_fleet_gateway.extensions.pages.views import places
from linked_fleet_gateway.extensions.sessions.cookies import LOGIN, read_cookie, session_of, set_cookie
from linked_fleet_gateway.extensions.sessions.invitations import LINK_PATH
from linked_fleet_gateway.extensions.sessions.sealed_cookie import SESSION_S, PendingLogin, open_login, seal_login
from linked_fleet_gateway.extensions.sessions.service import Sessions
from linked_fleet_gateway.faces import Claims, Credential, Identity, TokenHash
from linked_fleet_gateway.serving import BadToken, Issuer, IssuerFailed, TokenBuckets, arrival_of, read_body
from linked_fleet_server.addresses import network_of


class TooManyLogins(FleetError):
    """Too many logins from one address failed. ``Retry-After`` gives the time until another failure is permitted."""

    status, code, title = 429, "too-many-logins", "Too many attempts to log in"

    def __init__(self, detail: str, *, retry_after_s: int) -> None:
        super().__init__(detail, headers={"Retry-After": str(retry_after_s)})


log = logging.getLogger(__name__)

_PAGES = {
    "/login": ("GET", "POST"),
    "/login/start": ("GET",),
    "/login/return": ("GET",),
    LINK_PATH: ("GET",),
    "/logout": ("POST",),
}
MAX_BODY_BYTES = 32 * 1024
_LONGEST_PATH = 2000
FAILURES = 10
"""Failed logins of one address that get the page; afterwards one more every ``REFILL_S``."""
REFILL_S = 6.0
_NO_STORE = {"cache-control": "no-store"}


class Login:
    """Serves the login paths for everybody, also without authentication."""

    def __init__(self) -> None:
        self._failures = TokenBuckets(1 / REFILL_S, burst=FAILURES)
        self._openings = TokenBuckets(1 / REFILL_S, burst=FAILURES)
        """Openings by the hash of the link's token: each is in the audit, which has room for so many."""

    def serves(self, path: str) -> bool:
        return path in _PAGES

    async def answer(self, request: Request, sessions: Sessions) -> Response:
        with speaking(request.languages):
            return await self._answer(request, sessions)

    async def _answer(self, request: Request, sessions: Sessions) -> Response:
        path: str = request.scope["path"]
        method = "GET" if request.method == "HEAD" else request.method
        allow = _PAGES[path]
        if method not in allow:
            raise MethodNotAllowed(f"{method} is not possible here; {', '.join(allow)} are.", allow=allow)
        if path == "/logout":
            return await _log_out(request, sessions)
        if path == "/login/start":
            return await self._start(request, sessions)
        if path == LINK_PATH:
            return await self._as_guest(request, sessions)
        if path == "/login/return":
            return await self._return(request, sessions)
        if method == "POST":
            return await self._with_token(request, sessions)
        return _page(
            sessions, _path(request.query_params.get("then")), request.caller, restricted_paths=request.restricted_paths
        )

    def _failed(self, request: Request, error: BadToken) -> None:
        """Count a failed login and log it. Raises TooManyLogins beyond the limit of the address.

        Only failures are refused, and only after the check: many people may share an address, and a guesser among them
        must not lock the others out. The entropy of tokens bounds guessing, as with ``Authorization``.
        """
        address = request.client.host if request.client else ""
        if wait_s := math.ceil(self._failures.take(network_of(address))):
            raise TooManyLogins(
                f"The login failed, as others from this address did. Try again in {wait_s} s.", retry_after_s=wait_s
            ) from error
        log.info("a login from %s failed: %s", address, error)

    # -- by a token ---------------------------------------------------------------------------------------------------

    async def _with_token(self, request: Request, sessions: Sessions) -> Response:
        ours = "origin" in request.headers or request.headers.get("sec-fetch-site") == "same-origin"
        if arrival_of(request.scope).cross_origin or not ours:
            raise ForeignOrigin("people log in here on the page itself; programs send Authorization: Bearer")
        form = parse_qs((await read_body(request, MAX_BODY_BYTES)).decode("utf-8", "replace"))
        token, then = _one(form, "token").strip(), _path(_one(form, "then"))
        try:
            found = await sessions.identities.bearer(token)
        except BadToken as error:
            self._failed(request, error)
            return _page(sessions, then, None, say("This token is not accepted: {reason}.", reason=error), status=401)
        except IssuerFailed as error:
            raise IssuerDown("The issuer of this token cannot be asked for its keys; try again in a moment.") from error
        assert found.credential is not None
        return await _logged_in(request, sessions, found.credential, then)

    # -- by an invitation ---------------------------------------------------------------------------------------------

    async def _as_guest(self, request: Request, sessions: Sessions) -> Response:
        """Begin a session of a guest. The token leaves the address with the redirection."""
        if session_of(request.scope) is not None:
            who = request.caller.name
            failed = say(
                "You are logged in as {who}. Log out to use an invitation, or open it in another browser.", who=who
            )
            return _page(sessions, "/", request.caller, status=409, failed=failed)
        try:
            if sessions.invitations is None:
                raise BadToken("this gateway has no invitations")
            id, invitation = sessions.invitations.find(request.query_params.get("token", ""), time.time_ns())
        except BadToken as error:
            self._failed(request, error)
            sentence = str(error)
            failed = say("{reason}. Ask who sent it to you for a new one.", reason=sentence[:1].upper() + sentence[1:])
            return _page(sessions, "/", None, status=401, failed=failed)
        if wait_s := math.ceil(self._openings.take(invitation.sha256)):
            raise TooManyLogins(f"This link was opened too often. Try again in {wait_s} s.", retry_after_s=wait_s)
        sessions.invitations.opened(id, invitation)
        return await _logged_in(request, sessions, TokenHash(invitation.sha256), "/")

    # -- at an issuer -------------------------------------------------------------------------------------------------

    async def _start(self, request: Request, sessions: Sessions) -> Response:
        name = request.query_params.get("issuer", "")
        issuer = next((each for each in sessions.identities.roster.issuers.values() if each.name == name), None)
        if issuer is None or not issuer.client_id:
            raise NotFound("There is no such issuer to log in at.")
        state, nonce, verifier = (secrets.token_urlsafe(32) for _ in range(3))
        login = PendingLogin(issuer.url, state, nonce, verifier, _path(request.query_params.get("then")))
        try:
            there = await sessions.identities.keys(issuer).endpoint("authorization_endpoint")
        except IssuerFailed as error:
            raise IssuerDown(f"{issuer.name} cannot be reached; try again in a moment.") from error
        challenge = urlsafe_b64encode(sha256(login.verifier.encode()).digest()).rstrip(b"=").decode()
        query = {
            "response_type": "code",
            "client_id": issuer.client_id,
            "redirect_uri": _return_url(request),
            "scope": "openid",
            "state": login.state,
            "nonce": login.nonce,
            "code_challenge": challenge,
            "code_challenge_method": "S256",
        }
        response = RedirectResponse(f"{there}{'&' if '?' in there else '?'}{urlencode(query)}", 303, _NO_STORE)
        set_cookie(request.scope, response, seal_login(login, await sessions.key.get(), time.time_ns()), LOGIN)
        return response

    async def _return(self, request: Request, sessions: Sessions) -> Response:
        login = open_login(read_cookie(request.scope, LOGIN), await sessions.key.get())
        issuer = None if login is None else sessions.identities.roster.issuers.get(login.issuer)
        try:
            if login is None or issuer is None:
                raise BadToken("it took too long, or began in another browser")
            claims = await _claims(request, sessions, issuer, login)
        except BadToken as error:
            self._failed(request, error)
            return _page(sessions, "/", None, failed=say("You are not logged in: {reason}.", reason=error), status=401)
        except IssuerFailed as error:
            log.warning("a login failed: %s", error)
            raise IssuerDown("The issuer does not answer as it should; try again in a moment.") from error
        response = await _logged_in(request, sessions, claims, login.then)
        set_cookie(request.scope, response, "", LOGIN)
        return response


async def _claims(request: Request, sessions: Sessions, issuer: Issuer, login: PendingLogin) -> Claims:
    """Return the claims of a person who returns from the issuer with a code. Raises BadToken, IssuerFailed."""
    said = request.query_params
    if not compare_digest(said.get("state", "").encode(), login.state.encode()):
        raise BadToken("it began in another browser")
    if said.get("iss", issuer.url) != issuer.url or "code" not in said:  # RFC 9207; or an error
        raise BadToken(f"{issuer.name} refused ({said.get('error', 'no code')[:100]})")
    keys = sessions.identities.keys(issuer)
    form = {
        "grant_type": "authorization_code",
        "code": said["code"],
        "redirect_uri": _return_url(request),
        "client_id": issuer.client_id,
        "code_verifier": login.verifier,
    }
    secret = (quote(issuer.client_id, safe=""), quote(issuer.client_secret, safe="")) if issuer.client_secret else None
    there = await keys.endpoint("token_endpoint")
    answer = await sessions.identities.web.post(there, form, secret)
    token: Any = answer.get("id_token")
    if not isinstance(token, str):
        raise IssuerFailed(f"{issuer.url} gave no id_token")
    found = await sessions.identities.verify(token, issuer, issuer.client_id)
    if not compare_digest(str(found.get("nonce", "")).encode(), login.nonce.encode()):
        raise BadToken("the nonce of its id_token is wrong")
    if found.get("azp", issuer.client_id) != issuer.client_id:
        raise BadToken("its id_token is for another client")
    claims = issuer.claims(found, time.time_ns() + SESSION_S * 1_000_000_000)
    if claims is None:
        raise BadToken(f"{issuer.name} does not say who you are")
    return claims


def _return_url(request: Request) -> str:
    return request.base + "/login/return"


# -- in and out -----------------------------------------------------------------------------------------------------


async def _logged_in(request: Request, sessions: Sessions, credential: Credential, then: str) -> Response:
    response = RedirectResponse(request.base + then, 303, _NO_STORE | {"referrer-policy": "no-referrer"})
    set_cookie(request.scope, response, await sessions.begin(credential))
    return response


async def _log_out(request: Request, sessions: Sessions) -> Response:
    session = session_of(request.scope)
    if session is not None:
        await sessions.end(session)
    response = RedirectResponse(request.base + "/login", 303, _NO_STORE)
    set_cookie(request.scope, response, "")
    return response


def _page(
    sessions: Sessions,
    then: str,
    caller: Identity | None,
    wrong: str = "",
    status: int = 200,
    failed: str = "",
    restricted_paths: Sequence[str] = (),
) -> Response:
    """Render the page; ``wrong`` is an error of the entered token, ``failed`` one of a login at an issuer."""
    issuers = [
        (each.name, "/login/start?" + urlencode({"issuer": each.name, "then": then}))
        for each in sessions.identities.roster.issuers.values()
        if each.client_id
    ]
    known = caller is not None and bool(caller.name)
    page = render(
        "login.html",
        places=places(None, restricted_paths) if known else [],
        name=caller.name if caller else "",
        rights=_rights(caller) if caller else [],
        issuers=issuers,
        then=then,
        here=f"/login?{urlencode({'then': then})}",
        wrong=wrong,
        failed=failed,
    )
    headers = _NO_STORE | {"content-security-policy": FORMS, "x-content-type-options": "nosniff"}
    headers |= {"vary": "Accept, Accept-Language, Cookie", "content-language": language()}
    # with stricter policies browsers send "Origin: null" to this gateway too
    headers |= {"referrer-policy": "same-origin"}
    return Response(page, status, headers, "text/html; charset=utf-8")


_MEANINGS = {
    Right.READ: message("see robots, and all that is known of them"),
    Right.SUBSCRIBE: message("follow changes, write rules and have messages sent"),
    Right.STOP: message("stop robots"),
    Right.ACT: message("have robots move, and take control of them"),
    Right.PERSON: message("take control from programs"),
    Right.ADMIN: message("change settings, see what others did"),
}


def _rights(caller: Identity) -> list[tuple[str, str, str]]:
    """Return each right with its meaning and the robots that it covers; empty for none."""
    found = []
    for right, meaning in _MEANINGS.items():
        robots = caller.view_for(right)
        found.append(
            (right.value, translated(meaning), say("all robots") if robots.includes_all else ", ".join(robots.patterns))
        )
    return found


def _one(form: dict[str, list[str]], name: str) -> str:
    values = form.get(name, [""])
    if len(values) != 1:
        raise BadRequest(f"The form must have {name} exactly once.")
    return values[0]


def _path(said: str | None) -> str:
    """Return the path to open after the login; always on this host, ``/`` if ``said`` is invalid."""
    if not said or not said.startswith("/") or len(said) > _LONGEST_PATH:
        return "/"
    return quote(said, safe="/~?&=%.,:;@!$'()*+-_")
