"""The extension ``sessions``: browser login, with a token or at an issuer.

A session cookie authenticates browsers; their requests must come from the gateway's own pages.
"""

import logging
from collections.abc import AsyncIterator, Sequence
from contextlib import asynccontextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import ClassVar
from urllib.parse import quote

from starlette.datastructures import Headers
from starlette.responses import RedirectResponse, Response
from starlette.types import Receive, Scope

from linked_fleet_base.errors import ForeignOrigin, Unauthenticated
from linked_fleet_base.settings import FILE, Section, setting
from linked_fleet_gateway.api import (
    Core,
    Extension,
    Mount,
    Request,
    RequestEvent,
    Table,
    cancel_tasks,
    choose,
    supervised,
)  # fmt: skip
from linked_fleet_gateway.extensions.sessions.cookies import read_cookie, record_session
from linked_fleet_gateway.extensions.sessions.invitations import (
    MOST,
    PATH,
    SEGMENT,
    Invitation,
    Invitations,
    Invite,
    branch_of,
    container_of,
    invite,
)  # fmt: skip
from linked_fleet_gateway.extensions.sessions.login import Login
from linked_fleet_gateway.extensions.sessions.service import EndedSessions, SessionKey, Sessions
from linked_fleet_gateway.faces import HTML
from linked_fleet_gateway.serving import Authenticated, arrival_of
from linked_fleet_rdf.serialise import RDF_TYPES

log = logging.getLogger(__name__)
HERE = Path(__file__).parent
FORGET_S = 60.0


@dataclass(frozen=True)
class SessionSettings(Section):
    prefix: ClassVar[str] = "LINKED_FLEET_SESSION_"

    key_file: Path | None = setting(
        FILE, "", "key of browser sessions, 32 bytes in base64; empty: made once and kept in Redis"
    )


_READ = ("GET", "HEAD", "OPTIONS")


class SessionScheme:
    """Implements ``linked_fleet_gateway.http.arrival.Scheme``."""

    hint = "Log in at /login."

    def __init__(self, sessions: Sessions) -> None:
        self._sessions, self._login = sessions, Login()

    async def authenticate(self, scope: Scope) -> Authenticated | None:
        sealed = read_cookie(scope)
        if not sealed:
            return None
        _check_page(scope, Headers(scope=scope))
        found = await self._sessions.find(sealed)
        if found is None:
            raise Unauthenticated(f"The session is over. {self.hint}", wrong=True)
        caller, session = found
        record_session(scope, session)
        return Authenticated(caller, partial(self._sessions.is_valid, session), shown_on_pages=True)

    def has_page(self, path: str) -> bool:
        return self._login.serves(path)

    async def answer(self, scope: Scope, receive: Receive) -> Response:
        return await self._login.answer(Request(scope, receive), self._sessions)

    def login_response(self, scope: Scope) -> Response | None:
        return _to_login(scope) if _would_log_in(scope) else None


def _check_page(scope: Scope, headers: Headers) -> None:
    """Raise ForeignOrigin for a request with a cookie that writes or listens, unless it comes from our own page.

    ``Authorities`` has refused or marked foreign origins; here a missing Origin is refused too. Pages of other sites
    must use tokens, because otherwise they would act for the person who is logged in. Reads are exempt: other sites may
    link here, and only the reader sees the response.
    """
    events = arrival_of(scope).names_event_stream
    calls_back = "callback" in headers.get("upgrade", "").lower()
    reads = scope["type"] == "http" and scope["method"] in _READ and not events and not calls_back
    elsewhere = arrival_of(scope).cross_origin
    ours = headers.get("sec-fetch-site") == "same-origin" or ("origin" in headers and not calls_back and not elsewhere)
    if not reads and not ours:
        raise ForeignOrigin(
            "a request with a session cookie needs an Origin field of this gateway; or send a bearer token"
        )


def _would_log_in(scope: Scope) -> bool:
    """Return True for a browser navigation that expects a page."""
    if scope["type"] != "http" or scope["method"] not in ("GET", "HEAD"):
        return False
    arrival = arrival_of(scope)
    if b"accept" not in arrival.fields or arrival.names_event_stream:
        return False
    return choose(arrival.fields[b"accept"].decode("latin-1"), (*RDF_TYPES, HTML)) == HTML


def _to_login(scope: Scope) -> RedirectResponse:
    query = scope.get("query_string", b"").decode("latin-1")
    then = quote(scope["path"] + (f"?{query}" if query else ""), safe="")
    headers = {"cache-control": "no-store", "vary": "Accept"}
    return RedirectResponse(f"{arrival_of(scope).base}/login?then={then}", 303, headers)


class SessionsExtension(Extension):
    name = "sessions"
    at_root = ("login", "logout", SEGMENT)
    needs = ("pages",)
    settings = SessionSettings
    vocabulary = (HERE / "vocabulary.ttl",)
    shapes = (HERE / "shapes.ttl",)

    def views(self) -> Sequence[object]:
        from linked_fleet_gateway.extensions.sessions import page

        return (page.VIEW,)

    @asynccontextmanager
    async def start(self, core: Core) -> AsyncIterator[Mount]:
        if core.identities is None:
            yield Mount()
            return
        key = SessionKey(core.redis_url, core.namespace, str(core.section(SessionSettings).key_file or ""))
        ended = EndedSessions(core.redis_url, core.namespace)
        async with (
            Sessions(core.identities, key, ended) as sessions,
            core.open_container("invitations", Invitation, container_of, MOST) as container,
        ):
            records = container.records
            assert isinstance(records, Table)

            def opened(id: str, invitation: Invitation) -> None:
                core.tell_of_request(RequestEvent(invitation.guest.name, "INVITATION", f"{PATH}/{id}", status=303))

            sessions.invitations = invitations = Invitations(records, opened)
            core.identities.find_elsewhere = invitations.guest
            tasks = [supervised(invitations.forget_expired, "forget invitations", log, "they stay listed", FORGET_S)]
            try:
                yield Mount(
                    scheme=SessionScheme(sessions),
                    branches=(branch_of(container),),
                    writers={Invite: invite(container)},
                    services=(sessions,),
                )
            finally:
                await cancel_tasks(tasks)
