"""An OpenID Connect issuer: discovery, keys, and logins that it grants as the test says.

It listens on loopback, or in memory on virtual time.
"""

import base64
import contextlib
import hashlib
import json
import secrets
import time
from collections.abc import Iterator
from typing import Any
from unittest import mock
from urllib.parse import parse_qs, urlencode, urlsplit

import jwt
from cryptography.hazmat.primitives.asymmetric import ec, ed25519, rsa
from jwt.algorithms import ECAlgorithm, OKPAlgorithm, RSAAlgorithm

from receivers import Answer, Receiver, Seen, receiving
from virtual.clock import Datetime
from virtual.loop import current

AUDIENCE, CLIENT, SECRET = "the-fleet", "the-pages", "s e:cret"


class Key:
    """A key pair with its id."""

    def __init__(self, kid: str, algorithm: str = "ES256") -> None:
        self.kid, self.algorithm = kid, algorithm
        self.private: Any
        if algorithm == "ES256":
            self.private, form = ec.generate_private_key(ec.SECP256R1()), ECAlgorithm
        elif algorithm == "EdDSA":
            self.private, form = ed25519.Ed25519PrivateKey.generate(), OKPAlgorithm
        else:
            self.private, form = rsa.generate_private_key(65537, 2048), RSAAlgorithm
        said = form.to_jwk(self.private.public_key())
        self.public: dict[str, Any] = (json.loads(said) if isinstance(said, str) else said) | {"kid": kid, "use": "sig"}


class Issuer:
    """``keys``: those that it publishes. ``subject``: who logs in; ``claims``: further claims about it."""

    def __init__(self, server: Receiver) -> None:
        self.keys = [Key("first")]
        self.subject, self.claims = "ada", {"groups": ["operators"]}
        self.fetched = 0
        self.silent = False
        self._codes: dict[str, dict[str, str]] = {}
        self._server = server
        self._server.take = self._answer  # type: ignore[method-assign]
        self.url = server.url("")

    def release(self) -> None:
        """Answer the requests that were delayed, and delay no more."""
        self.silent = False
        self._server.release()

    def token(
        self,
        key: Key | None = None,
        algorithm: str | None = None,
        secret: Any = None,
        *,
        typ: str | None = "JWT",
        **claims: Any,
    ) -> str:
        """Return a token of this issuer; ``claims`` replace its usual claims, None removes one."""
        key, now_s = key or self.keys[0], int(time.time())
        said = {"iss": self.url, "aud": AUDIENCE, "sub": self.subject, "iat": now_s, "exp": now_s + 300}
        said = {name: value for name, value in (said | self.claims | claims).items() if value is not None}
        return jwt.encode(said, secret or key.private, algorithm or key.algorithm, headers={"kid": key.kid, "typ": typ})

    # -- what it is asked ---------------------------------------------------------------------------------------------

    def document(self) -> dict[str, str]:
        return {
            "issuer": self.url,
            "jwks_uri": f"{self.url}/keys",
            "authorization_endpoint": f"{self.url}/authorize",
            "token_endpoint": f"{self.url}/token",
        }

    def authorize(self, asked: dict[str, str]) -> str:
        """Return the URL to which the browser is redirected."""
        assert asked["client_id"] == CLIENT and asked["response_type"] == "code"
        assert asked["code_challenge_method"] == "S256" and "openid" in asked["scope"].split()
        code = secrets.token_urlsafe(16)
        self._codes[code] = asked
        query = urlencode({"code": code, "state": asked["state"], "iss": self.url})
        return f"{asked['redirect_uri']}?{query}"

    def exchange(self, form: dict[str, str], authorization: str) -> dict[str, str] | None:
        asked = self._codes.pop(form.get("code", ""), None)
        challenge = base64.urlsafe_b64encode(hashlib.sha256(form["code_verifier"].encode()).digest()).rstrip(b"=")
        basic = "Basic " + base64.b64encode(f"{CLIENT}:s%20e%3Acret".encode()).decode()
        if asked is None or challenge.decode() != asked["code_challenge"] or authorization != basic:
            return None
        if form["redirect_uri"] != asked["redirect_uri"]:
            return None
        return {"id_token": self.token(aud=CLIENT, nonce=asked["nonce"]), "token_type": "Bearer", "access_token": "x"}

    def _answer(self, seen: Seen) -> Answer:
        parts = urlsplit(seen.path)
        if seen.method == "POST":
            granted = self.exchange(_single(seen.body.decode()), seen.headers.get("authorization", ""))
            return self._say(granted or {"error": "invalid_grant"}, 200 if granted else 400)
        if parts.path == "/.well-known/openid-configuration":
            return self._say(self.document())
        if parts.path == "/keys":
            self.fetched += 1
            return self._say({"keys": [key.public for key in self.keys]})
        if parts.path == "/authorize":
            return Answer(303, {"Location": self.authorize(_single(parts.query))})
        return Answer(404)

    def _say(self, said: object, status: int = 200) -> Answer:
        """Return JSON, which is delayed while the issuer is silent."""
        return Answer(status, {"Content-Type": "application/json"}, json.dumps(said).encode(), stalls=self.silent)


def _single(query: str) -> dict[str, str]:
    return {name: values[0] for name, values in parse_qs(query).items()}


@contextlib.contextmanager
def issuing() -> Iterator[Issuer]:
    with contextlib.ExitStack() as stack:
        if current() is not None:  # PyJWT reads the time by ``datetime``
            stack.enter_context(mock.patch.object(jwt.api_jwt, "datetime", Datetime))
        yield Issuer(stack.enter_context(receiving()))
