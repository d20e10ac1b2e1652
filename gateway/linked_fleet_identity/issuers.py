"""Issuers of tokens: their documents, their keys, and the tokens that the keys verify.

Tokens follow RFC 8725, keys OpenID Connect Discovery 1.0 and RFC 7517. Documents of issuers are JSON, fetched by HTTP
and bounded in size and time.
"""

import asyncio
import json
import ssl
import time
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any
from urllib.parse import urlsplit

from linked_fleet_base.lazy_imports import LazyModule
from linked_fleet_identity.roster import Issuer
from linked_fleet_runtime.background import cancel_tasks

if TYPE_CHECKING:
    import httpx
    import jwt
else:
    httpx = LazyModule("httpx")
    jwt = LazyModule("jwt")

_TIMEOUT_S = 5.0  # for a complete exchange
_MOST_BYTES = 1024 * 1024


class IssuerFailed(Exception):  # noqa: N818 -- a state of the issuer, not a defect
    """No usable answer; the text says why."""


class Web:
    """Requests to issuers. Redirects are not followed, and only JSON objects are accepted."""

    def __init__(self) -> None:
        # Proxies of the environment are ignored, because answers must come from the issuer itself.
        self._client = httpx.AsyncClient(verify=ssl.create_default_context(), trust_env=False, timeout=_TIMEOUT_S)

    async def aclose(self) -> None:
        await self._client.aclose()

    async def get(self, url: str) -> dict[str, Any]:
        """Return a JSON document. Raises IssuerFailed."""
        return await self._ask("GET", url)

    async def post(self, url: str, form: Mapping[str, str], secret: tuple[str, str] | None) -> dict[str, Any]:
        """Post a form; ``secret`` is the client id and password, if any. Raises IssuerFailed."""
        return await self._ask("POST", url, data=dict(form), auth=secret)

    async def _ask(self, method: str, url: str, **said: Any) -> dict[str, Any]:
        try:
            async with (
                asyncio.timeout(_TIMEOUT_S),
                self._client.stream(method, url, headers={"accept": "application/json"}, **said) as response,
            ):
                body = b""
                async for piece in response.aiter_bytes():
                    body += piece
                    if len(body) > _MOST_BYTES:
                        raise IssuerFailed(f"{url} answered with more than {_MOST_BYTES} bytes")
        except (httpx.HTTPError, httpx.InvalidURL, TimeoutError, OSError) as error:
            raise IssuerFailed(f"{url}: {type(error).__name__} {error}") from error
        if response.status_code != 200:
            raise IssuerFailed(f"{url} answered with status {response.status_code}")
        try:
            found = json.loads(body)
        except ValueError as error:
            raise IssuerFailed(f"{url} answered with what is no JSON") from error
        if not isinstance(found, dict):
            raise IssuerFailed(f"{url} answered with what is no object of JSON")
        return found


STALE_S = 600.0  # age at which keys are fetched again, to notice a withdrawn one
RETRY_S = 30.0
FIRST_S = 2.0  # between two attempts while no key is known
# Determined by the key and never by the token, so that a public key cannot be used as a shared secret.
_ALGORITHMS = {("RSA", None): "RS256", ("EC", "P-256"): "ES256", ("OKP", "Ed25519"): "EdDSA"}
_LEAST_RSA_BITS = 2048


class IssuerKeys:
    """Cached keys; ``metadata`` is the discovery document of the issuer at ``url``, empty before the first fetch."""

    def __init__(self, web: Web, url: str) -> None:
        self._web, self._url = web, url
        self.metadata: dict[str, Any] = {}
        self._keys: dict[str, tuple[jwt.PyJWK, str]] = {}
        self._fetched_s = self._tried_s = self._asked_s = float("-inf")
        self._turn = asyncio.Lock()
        self._refreshing: asyncio.Task[None] | None = None

    async def find(self, kid: str) -> "tuple[jwt.PyJWK, str] | None":
        """Return a key and its only algorithm; None if the issuer has no such id. Raises IssuerFailed if no keys are
        known.

        An unknown id causes a new fetch, at most every 30 s. Known keys stay valid while the issuer is unreachable.
        """
        if kid not in self._keys:
            await self._fetch_again(kid)
        elif self._stale and (self._refreshing is None or self._refreshing.done()):
            # In the background, because the request may be a stop.
            self._refreshing = asyncio.create_task(self._fetch_again(kid), name=f"keys of {self._url}")
        if not self._keys:
            raise IssuerFailed(f"the keys of {self._url} could not be fetched")
        return self._keys.get(kid)

    async def aclose(self) -> None:
        if self._refreshing is not None:
            await cancel_tasks([self._refreshing])

    @property
    def _stale(self) -> bool:
        return time.monotonic() - self._fetched_s > STALE_S

    async def discovery_document(self) -> dict[str, Any]:
        """Return the discovery document. Raises IssuerFailed."""
        async with self._turn:
            if not self.metadata:
                if time.monotonic() - self._asked_s < FIRST_S:
                    raise IssuerFailed(f"{self._url} did not answer a moment ago")
                self._asked_s = time.monotonic()
                self.metadata = await self._discover()
        return self.metadata

    async def endpoint(self, name: str) -> str:
        """Return an endpoint that the discovery document names. Raises IssuerFailed."""
        return endpoint(await self.discovery_document(), name, self._url)

    async def _fetch_again(self, kid: str) -> None:
        async with self._turn:
            now_s = time.monotonic()
            pause_s = RETRY_S if self._keys else FIRST_S
            if now_s - self._tried_s < pause_s or (kid in self._keys and not self._stale):
                return
            self._tried_s = now_s
            try:
                self.metadata = await self._discover()
                said = await self._web.get(endpoint(self.metadata, "jwks_uri", self._url))
            except IssuerFailed:
                if not self._keys:
                    raise
                return
            self._keys = _usable(said)
            self._fetched_s = now_s

    async def _discover(self) -> dict[str, Any]:
        found = await self._web.get(self._url.rstrip("/") + "/.well-known/openid-configuration")
        if found.get("issuer") != self._url:
            raise IssuerFailed(f"{self._url} says that it is the issuer {found.get('issuer')!r}")
        return found


def endpoint(metadata: dict[str, Any], name: str, issuer: str) -> str:
    """Return an endpoint of the issuer, with a scheme as safe as the issuer's. Raises IssuerFailed."""
    url = metadata.get(name)
    if not isinstance(url, str) or urlsplit(url).scheme not in ("https", urlsplit(issuer).scheme):
        raise IssuerFailed(f"{issuer} names no usable {name}")
    return url


def _usable(said: dict[str, Any]) -> "dict[str, tuple[jwt.PyJWK, str]]":
    """Return usable keys by id, without those for other purposes, of other types or without id."""
    found = {}
    listed = said.get("keys")
    for each in listed if isinstance(listed, list) else ():
        algorithm = _algorithm(each) if isinstance(each, dict) else None
        if algorithm is None:
            continue
        try:
            found[each["kid"]] = (jwt.PyJWK(each, algorithm), algorithm)
        except (jwt.PyJWTError, ValueError, TypeError):
            continue  # skips a broken key among good ones
    return found


def _algorithm(key: dict[str, Any]) -> str | None:
    kind, curve = key.get("kty"), key.get("crv")
    if not isinstance(kind, str) or not isinstance(curve, str | None):
        return None
    algorithm = _ALGORITHMS.get((kind, curve))
    fits = key.get("use", "sig") == "sig" and key.get("alg", algorithm) == algorithm and isinstance(key.get("kid"), str)
    if kind == "RSA" and len(str(key.get("n"))) * 6 < _LEAST_RSA_BITS - 8:
        return None
    return algorithm if fits else None


LEEWAY_S = 30
MOST_CHARACTERS = 16_384
_TYPES = ("jwt", "at+jwt")
"""Kinds of tokens of identities and of access (RFC 7519, 5.1; RFC 9068, 2.1)."""


class BadToken(Exception):  # noqa: N818 -- named like the other outcomes
    """The token is malformed, for another audience, or not valid now; the text says which."""


def claimed_issuer(text: str) -> str | None:
    """Return the unverified issuer that a token claims; None if it is not a token."""
    if len(text) > MOST_CHARACTERS or text.count(".") != 2:
        return None
    try:
        said = jwt.decode(text, options={"verify_signature": False})
    except (jwt.PyJWTError, ValueError, RecursionError):
        return None
    found = said.get("iss")
    return found if isinstance(found, str) else None


async def verify_token(text: str, issuer: Issuer, keys: IssuerKeys, audience: str) -> dict[str, Any]:
    """Return the claims of a token signed by ``issuer`` for ``audience``. Raises BadToken, IssuerFailed.

    The key determines the algorithm, which is always asymmetric; the header of the token must agree.
    """
    try:
        header = jwt.get_unverified_header(text)
    except (jwt.PyJWTError, ValueError, RecursionError) as error:
        raise BadToken("it is no JSON Web Token") from error
    _check_type(header.get("typ"))
    kid = header.get("kid")
    found = await keys.find(kid) if isinstance(kid, str) else None
    if found is None:
        raise BadToken("its issuer has no such key")
    key, algorithm = found
    try:
        said: dict[str, Any] = jwt.decode(
            text,
            key.key,
            algorithms=[algorithm],
            audience=audience,
            issuer=issuer.url,
            leeway=LEEWAY_S,
            options={"require": ["exp", "iss", "aud"]},
        )
    except jwt.ExpiredSignatureError as error:
        raise BadToken("it has expired") from error
    except jwt.ImmatureSignatureError as error:
        raise BadToken("it is not valid yet") from error
    except jwt.InvalidAudienceError as error:
        raise BadToken("it is for another audience") from error
    except (jwt.PyJWTError, ValueError, TypeError, OverflowError, RecursionError) as error:
        raise BadToken("it is not signed by its issuer, or does not say what it must") from error
    _check_claims(said)
    return said


def _check_type(kind: object) -> None:
    """Raise BadToken for a token of another kind, such as one that ends sessions (RFC 8725, 3.11)."""
    if kind is not None and str(kind).lower().removeprefix("application/") not in _TYPES:
        raise BadToken(f"its typ is {str(kind)[:40]!r}, not JWT or at+jwt")


def _check_claims(said: dict[str, Any]) -> None:
    """Raise BadToken for a time that is no number (RFC 7519, 2), and for a security event (RFC 8417, 2.2)."""
    for name in ("exp", "nbf", "iat"):
        if name in said and (isinstance(said[name], bool) or not isinstance(said[name], int | float)):
            raise BadToken(f"its {name} is no number")
    if "events" in said:
        raise BadToken("it is a security event")


def expiry_ns(said: dict[str, Any]) -> int:
    """Return the wall time in ns at which verified claims expire."""
    # an int, because issuers may state times beyond the precision of a float
    return (int(said["exp"]) + LEEWAY_S) * 1_000_000_000
