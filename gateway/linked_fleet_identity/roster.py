"""The file of identities (docs/IDENTITIES.md), parsed into typed values, and the lookup of identities."""

import hmac
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from hashlib import sha256
from ipaddress import ip_address
from pathlib import Path
from typing import Any, Literal, TypeVar
from urllib.parse import urlsplit

import msgspec.toml

from linked_fleet_identity.rights import EVERY, Claims, Credential, Grant, Identity, Right, TokenHash

_ScopeName = Literal["read", "subscribe", "stop", "act", "person", "reset", "admin"]
_NAME = re.compile(r"[A-Za-z0-9._-]{1,64}")  # without "@", which separates subject and issuer in names
_DIGEST = re.compile(r"[0-9a-f]{64}")
_MOST_BYTES = 4 * 1024 * 1024
_T = TypeVar("_T")


class BadRoster(ValueError):  # noqa: N818 -- named like the other outcomes
    """The file is invalid. One line for people."""


class _Rights(msgspec.Struct, forbid_unknown_fields=True, kw_only=True):
    scopes: list[_ScopeName]
    robots: list[str] = msgspec.field(default_factory=lambda: [EVERY])


class _Token(_Rights):
    name: str
    sha256: str
    expires: datetime | None = None


class _Grant(_Rights):
    claim: str = ""
    value: str = ""


class _Issuer(msgspec.Struct, forbid_unknown_fields=True, kw_only=True):
    url: str
    audience: str
    name: str = ""
    name_claim: str = "sub"
    client_id: str = ""
    client_secret_file: str = ""
    grant: list[_Grant] = []


class _File(msgspec.Struct, forbid_unknown_fields=True):
    token: list[_Token] = []
    issuer: list[_Issuer] = []


@dataclass(frozen=True)
class Condition:
    """A grant to subjects whose ``claim`` has ``value``; without a claim, to all subjects of the issuer."""

    claim: str
    value: str
    grant: Grant


@dataclass(frozen=True)
class Issuer:
    """An issuer of tokens. ``client_id`` is empty without browser login, ``client_secret`` for a public client."""

    url: str
    audience: str
    name: str
    name_claim: str
    client_id: str
    client_secret: str
    conditions: tuple[Condition, ...]

    def claims(self, said: Mapping[str, Any], expires_ns: int) -> Claims | None:
        """Return the relevant claims of a verified token; None if it does not name its subject."""
        subject = _found(said, self.name_claim)
        if not isinstance(subject, str) or not 0 < len(subject) <= 255 or not subject.isprintable():
            return None
        asked = {(each.claim, each.value) for each in self.conditions if each.claim}
        facts = frozenset((claim, value) for claim, value in asked if _holds(_found(said, claim), value))
        return Claims(self.url, subject, facts, expires_ns)


@dataclass(frozen=True)
class Roster:
    """The contents of the file."""

    tokens: Mapping[str, Identity]
    """Identities by the SHA-256 of their token in hexadecimal."""
    issuers: Mapping[str, Issuer]
    """Issuers by URL."""

    def token(self, text: str) -> TokenHash | None:
        """Return the hash of a static token; None if there is no such token."""
        digest, found = sha256(text.encode(errors="surrogatepass")).hexdigest(), None
        for known in self.tokens:  # compares with all tokens, in constant time
            if hmac.compare_digest(known, digest):
                found = TokenHash(known)
        return found

    def identity(self, credential: Credential | None, now_ns: int) -> Identity | None:
        """Return the identity at ``now_ns``, wall time; None if it has expired or is not in the file."""
        if isinstance(credential, TokenHash):
            found = self.tokens.get(credential.sha256)
        elif isinstance(credential, Claims) and credential.issuer in self.issuers:
            found = _issued(self.issuers[credential.issuer], credential)
        else:
            return None
        expired = found is not None and found.expires_ns is not None and found.expires_ns <= now_ns
        return None if expired else found

    def holder(self, name: str, now_ns: int) -> Identity | None:
        """Return the identity of the static token with that name, unless it has expired."""
        found = next((each for each in self.tokens.values() if each.name == name), None)
        return None if found is None else self.identity(found.credential, now_ns)


def _issued(issuer: Issuer, claims: Claims) -> Identity:
    grants = tuple(
        each.grant for each in issuer.conditions if not each.claim or (each.claim, each.value) in claims.facts
    )
    return Identity(f"{claims.subject}@{issuer.name}", grants, claims.expires_ns, claims)


def _found(said: Mapping[str, Any], claim: str) -> Any:
    """Return a claim by its name, or by a path such as ``realm_access.roles``."""
    if claim in said:
        return said[claim]
    here: Any = said
    for part in claim.split("."):
        here = here.get(part) if isinstance(here, Mapping) else None
    return here


def _holds(said: object, value: str) -> bool:
    """Return True if a claim contains ``value``: as a member of a list, or as a word of a string, like ``scope``."""
    if isinstance(said, str):
        return said == value or value in said.split()
    return isinstance(said, Sequence) and value in said


# -- reading --------------------------------------------------------------------------------------------------------


def read_roster(path: Path) -> Roster:
    """Read the file. Raises BadRoster with one line that says what is wrong and where."""
    try:
        with path.open("rb") as file:
            content = file.read(_MOST_BYTES + 1)
        if len(content) > _MOST_BYTES:
            raise BadRoster(f"{path}: the file is longer than {_MOST_BYTES} bytes")
        return parse_roster(content.decode(), path.parent)
    except OSError as error:
        where = f" {error.filename}" if error.filename != str(path) else ""
        raise BadRoster(f"{path}:{where} {error.strerror}") from error
    except ValueError as error:  # from TOML, types or UTF-8
        raise BadRoster(f"{path}: {error}" if str(path) not in str(error) else str(error)) from error


def parse_roster(text: str, folder: Path) -> Roster:
    """Parse the file; ``folder`` is the base of relative paths in it. Raises ValueError."""
    said = msgspec.toml.decode(text, type=_File)
    tokens = [_token(each) for each in said.token]
    issuers = [_issuer(each, folder) for each in said.issuer]
    _once([each.name for each in tokens], "tokens are called")
    _once([each.name for each in issuers], "issuers are called")
    digests = [each.sha256 for each in said.token]
    _once(digests, "tokens have the sha256")
    urls = [each.url for each in issuers]
    _once(urls, "issuers have the url")
    return Roster(dict(zip(digests, tokens, strict=True)), dict(zip(urls, issuers, strict=True)))


def _once(values: Sequence[str], what: str) -> None:
    for value in values:
        if values.count(value) > 1:
            raise ValueError(f"two {what} {value!r}")


def _grant(rights: _Rights, whose: str) -> Grant:
    if not rights.scopes or not rights.robots or "" in rights.robots:
        raise ValueError(f"{whose} needs at least one of the scopes {', '.join(Right)}, and patterns of robots")
    return Grant(frozenset(map(Right, rights.scopes)), tuple(rights.robots))


def _token(said: _Token) -> Identity:
    if not _NAME.fullmatch(said.name):
        raise ValueError(f"the name of a token has 1 to 64 letters, digits, '.', '_' or '-', unlike {said.name!r}")
    whose = f"token {said.name}"
    if not _DIGEST.fullmatch(said.sha256):
        raise ValueError(f"sha256 of {whose} is not 64 lower-case hexadecimal digits")
    if said.expires is not None and said.expires.tzinfo is None:
        raise ValueError(f"expires of {whose} needs an offset from UTC, as in 2030-01-01T00:00:00Z")
    expires_ns = None if said.expires is None else int(said.expires.timestamp()) * 1_000_000_000
    return Identity(said.name, (_grant(said, whose),), expires_ns, TokenHash(said.sha256))


def _issuer(said: _Issuer, folder: Path) -> Issuer:
    parts = urlsplit(said.url)
    if parts.scheme != "https" and not (parts.scheme == "http" and _is_loopback(parts.hostname)):
        raise ValueError(f"the url of an issuer is an https URL, not {said.url!r}")
    name = said.name or parts.hostname or ""
    whose = f"issuer {name}"
    if not _NAME.fullmatch(name):
        raise ValueError(f"the name of an issuer has 1 to 64 letters, digits, '.', '_' or '-', unlike {name!r}")
    if not said.audience:
        raise ValueError(f"{whose} needs the audience that its tokens are for")
    secret = (folder / said.client_secret_file).read_text().strip() if said.client_secret_file else ""
    conditions = tuple(Condition(each.claim, each.value, _grant(each, f"a grant of {whose}")) for each in said.grant)
    return Issuer(said.url, said.audience, name, said.name_claim, said.client_id, secret, conditions)


def _is_loopback(host: str | None) -> bool:
    try:
        return host == "localhost" or ip_address(host or "").is_loopback
    except ValueError:
        return False
