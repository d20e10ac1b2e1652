"""Sealed cookies: sessions, and logins in progress. Pure."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

from linked_fleet_base.lazy_imports import LazyModule
from linked_fleet_gateway.faces import Claims, Credential, TokenHash

if TYPE_CHECKING:
    import jwt
else:
    jwt = LazyModule("jwt")

KEY_BYTES = 32
SESSION_S = 8 * 3600
TOKEN_SESSION_S = 30 * 86_400  # a token has its own expiry and can be revoked
LOGIN_S = 600
_ALGORITHM = "HS256"
_SECOND_NS = 1_000_000_000
_Purpose = Literal["session", "login"]


@dataclass(frozen=True)
class Session:
    """A login in one browser; ``id`` is unique to this login, ``ends_ns`` is wall time."""

    id: str
    credential: Credential
    ends_ns: int


@dataclass(frozen=True)
class PendingLogin:
    """A login in progress at an issuer (RFC 7636; OpenID Connect Core 1.0, 3.1.2.1)."""

    issuer: str
    state: str
    nonce: str
    verifier: str
    then: str
    """Path for the browser after the login."""


def new_session(credential: Credential, id: str, now_ns: int) -> Session:
    if isinstance(credential, TokenHash):
        return Session(id, credential, (now_ns // _SECOND_NS + TOKEN_SESSION_S) * _SECOND_NS)
    ends_s = min(now_ns // _SECOND_NS + SESSION_S, credential.expires_ns // _SECOND_NS)
    return Session(id, credential, ends_s * _SECOND_NS)


def seal_session(session: Session, key: bytes) -> str:
    of = session.credential
    if isinstance(of, TokenHash):
        said: dict[str, Any] = {"token": of.sha256}
    else:
        said = {"issuer": of.issuer, "subject": of.subject, "facts": sorted(of.facts)}
    return _seal("session", said | {"jti": session.id}, key, session.ends_ns // _SECOND_NS)


def open_session(text: str, key: bytes) -> Session | None:
    """Return the session; None if it was not sealed with ``key`` or has expired."""
    said = _opened("session", text, key)
    if said is None or "jti" not in said:  # older cookies had no id, so they could not be ended
        return None
    ends_ns = int(said["exp"]) * _SECOND_NS
    if "token" in said:
        return Session(said["jti"], TokenHash(said["token"]), ends_ns)
    facts = frozenset((claim, value) for claim, value in said["facts"])
    return Session(said["jti"], Claims(said["issuer"], said["subject"], facts, ends_ns), ends_ns)


def seal_login(login: PendingLogin, key: bytes, now_ns: int) -> str:
    return _seal("login", vars(login), key, now_ns // _SECOND_NS + LOGIN_S)


def open_login(text: str, key: bytes) -> PendingLogin | None:
    said = _opened("login", text, key)
    names = PendingLogin.__dataclass_fields__
    return None if said is None else PendingLogin(**{name: said[name] for name in names})


def _seal(purpose: _Purpose, said: Mapping[str, Any], key: bytes, ends_s: int) -> str:
    return jwt.encode({**said, "aud": purpose, "exp": ends_s}, key, _ALGORITHM)


def _opened(purpose: _Purpose, text: str, key: bytes) -> dict[str, Any] | None:
    try:
        return jwt.decode(text, key, [_ALGORITHM], audience=purpose, options={"require": ["exp", "aud"]})
    except (jwt.PyJWTError, ValueError):
        return None
