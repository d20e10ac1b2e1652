"""A real issuer of tokens on loopback: discovery, keys, and logins that it grants to whom the test says."""

import base64
import contextlib
import hashlib
import json
import secrets
import threading
import time
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any
from urllib.parse import parse_qs, urlencode, urlsplit

import jwt
from cryptography.hazmat.primitives.asymmetric import ec, ed25519, rsa
from jwt.algorithms import ECAlgorithm, OKPAlgorithm, RSAAlgorithm

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
    """``keys`` are those that it shows; ``subject`` is who logs in at it, of whom it says ``claims``."""

    def __init__(self) -> None:
        self.keys = [Key("first")]
        self.subject, self.claims = "ada", {"groups": ["operators"]}
        self.fetched = 0
        self.silent = False
        self._released = threading.Event()
        self._codes: dict[str, dict[str, str]] = {}
        handler = type("Handler", (_Handler,), {"issuer": self})
        self._server = ThreadingHTTPServer(("127.0.0.1", 0), handler)
        self.url = f"http://127.0.0.1:{self._server.server_address[1]}"
        self._thread = threading.Thread(target=self._server.serve_forever, kwargs={"poll_interval": 0.01})
        self._thread.start()

    def release(self) -> None:
        """Let go of whom it has kept waiting, and be silent no more."""
        self.silent = False
        self._released.set()

    def wait(self) -> None:
        """For the server: nothing is said while it is silent."""
        if self.silent:
            self._released.wait(60)

    def close(self) -> None:
        self.release()
        self._server.shutdown()
        self._thread.join()
        self._server.server_close()

    def token(self, key: Key | None = None, algorithm: str | None = None, secret: Any = None, **claims: Any) -> str:
        """A token of this issuer; ``claims`` replace what it says otherwise, None leaves out."""
        key, now_s = key or self.keys[0], int(time.time())
        said = {"iss": self.url, "aud": AUDIENCE, "sub": self.subject, "iat": now_s, "exp": now_s + 300}
        said = {name: value for name, value in (said | self.claims | claims).items() if value is not None}
        return jwt.encode(said, secret or key.private, algorithm or key.algorithm, headers={"kid": key.kid})

    # -- what it is asked ---------------------------------------------------------------------------------------------

    def document(self) -> dict[str, str]:
        return {
            "issuer": self.url,
            "jwks_uri": f"{self.url}/keys",
            "authorization_endpoint": f"{self.url}/authorize",
            "token_endpoint": f"{self.url}/token",
        }

    def authorize(self, asked: dict[str, str]) -> str:
        """Where the browser is sent back to."""
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


class _Handler(BaseHTTPRequestHandler):
    issuer: Issuer

    def do_GET(self) -> None:
        self.issuer.wait()
        parts = urlsplit(self.path)
        if parts.path == "/.well-known/openid-configuration":
            self._say(self.issuer.document())
        elif parts.path == "/keys":
            self.issuer.fetched += 1
            self._say({"keys": [key.public for key in self.issuer.keys]})
        elif parts.path == "/authorize":
            self.send_response(303)
            self.send_header("Location", self.issuer.authorize(_single(parts.query)))
            self.end_headers()
        else:
            self.send_error(404)

    def do_POST(self) -> None:
        form = _single(self.rfile.read(int(self.headers["Content-Length"])).decode())
        answer = self.issuer.exchange(form, self.headers.get("Authorization", ""))
        self._say(answer or {"error": "invalid_grant"}, 200 if answer else 400)

    def _say(self, said: object, status: int = 200) -> None:
        body = json.dumps(said).encode()
        self.send_response(status)
        self.send_header("Content-Type", "application/json")
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        self.wfile.write(body)

    def log_message(self, format: str, *args: Any) -> None:
        """Nobody reads it."""


def _single(query: str) -> dict[str, str]:
    return {name: values[0] for name, values in parse_qs(query).items()}


@contextlib.contextmanager
def issuing() -> Iterator[Issuer]:
    with contextlib.closing(Issuer()) as issuer:
        yield issuer
