"""The cookies of browser sessions."""

from starlette.requests import HTTPConnection
from starlette.responses import Response
from starlette.types import Scope

from linked_fleet_gateway.extensions.sessions.sealed_cookie import Session
from linked_fleet_gateway.serving import arrival_of

_SESSION = "linked-fleet"
_STATE = "sessions.session"
LOGIN = "-login"
"""Suffix of the name of the cookie of a login in progress at an issuer."""


def _is_https(scope: Scope) -> bool:
    return arrival_of(scope).base.startswith("https:")


def cookie_name(scope: Scope, suffix: str = "") -> str:
    """Return the name of the cookie. With TLS it has a prefix that other hosts cannot set (RFC 6265bis, 4.1.3)."""
    return f"{'__Host-' if _is_https(scope) else ''}{_SESSION}{suffix}"


def read_cookie(scope: Scope, suffix: str = "") -> str:
    return HTTPConnection(scope).cookies.get(cookie_name(scope, suffix), "")


def session_of(scope: Scope) -> Session | None:
    """Return the session that authenticated the request, or None."""
    session: Session | None = scope["state"].get(_STATE)
    return session


def record_session(scope: Scope, session: Session) -> None:
    """Record the session of a request for ``session_of``."""
    scope["state"][_STATE] = session


def set_cookie(scope: Scope, response: Response, value: str, suffix: str = "") -> None:
    """Set a cookie for the lifetime of the browser, invisible to scripts and not sent by pages of other sites.

    Without a value it is deleted.
    """
    age_s = None if value else 0
    response.set_cookie(
        cookie_name(scope, suffix), value, age_s, path="/", secure=_is_https(scope), httponly=True, samesite="lax"
    )
