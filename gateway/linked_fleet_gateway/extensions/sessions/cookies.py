"""The cookies of those who log in by a browser."""

from starlette.requests import HTTPConnection
from starlette.responses import Response
from starlette.types import Scope

from linked_fleet_gateway.extensions.sessions.sealed_cookie import Session

_SESSION = "linked-fleet"
_STATE = "sessions.session"
LOGIN = "-login"
"""The end of the name of the cookie of a login at an issuer that is under way."""


def _is_https(scope: Scope) -> bool:
    base: str = scope.get("state", {}).get("base", "")
    return base.startswith("https:")


def cookie_name(scope: Scope, suffix: str = "") -> str:
    """Over TLS one that no other host can set, and that never goes in the clear (RFC 6265bis, 4.1.3)."""
    return f"{'__Host-' if _is_https(scope) else ''}{_SESSION}{suffix}"


def read_cookie(scope: Scope, suffix: str = "") -> str:
    return HTTPConnection(scope).cookies.get(cookie_name(scope, suffix), "")


def session_of(scope: Scope) -> Session | None:
    """The session by which the caller of a request is known."""
    session: Session | None = scope["state"].get(_STATE)
    return session


def note_session(scope: Scope, session: Session) -> None:
    """Have ``session_of`` find the session of a request."""
    scope["state"][_STATE] = session


def set_cookie(scope: Scope, response: Response, value: str, suffix: str = "") -> None:
    """For as long as the browser is open; scripts do not see it, and pages of other sites do not send it.

    Without a value it is taken away.
    """
    age_s = None if value else 0
    response.set_cookie(
        cookie_name(scope, suffix), value, age_s, path="/", secure=_is_https(scope), httponly=True, samesite="lax"
    )
