"""Mutated credentials (tokens, JWTs and session cookies), each with the identity that it still proves."""

import base64
import json
import re
import time
from dataclasses import dataclass, field
from random import Random
from typing import Any

import jwt
from starlette.requests import cookie_parser

from fuzzing import mutation
from issuer import AUDIENCE, Issuer, Key

COOKIE = "__Host-linked-fleet"
SUBJECT = "the subject"
_GUESSED_SECRETS = (b"", b"k" * 32, b"\0" * 32, b"secret")
_DAY_S = 86_400
_NOT_IN_A_FIELD = re.compile(r"[\r\n\0]")


@dataclass
class CredentialSamples:
    """Valid credentials: static ``tokens`` and session ``cookies`` by owner, and the cookie of a pending login."""

    issuer: Issuer
    tokens: dict[str, str]
    cookies: dict[str, str] = field(default_factory=dict)
    underway: str = ""

    def __post_init__(self) -> None:
        self.stranger = Key(self.issuer.keys[0].kid)
        self.jwt = self.issuer.token(exp=int(time.time()) + _DAY_S)

    @property
    def state(self) -> str:
        """Return the state of the pending login, as the issuer would return it."""
        return str(json.loads(_decoded(self.underway.split(".")[1]))["state"])

    # -- as it is sent ------------------------------------------------------------------------------------------------

    def bearer(self, random: Random) -> tuple[str, str | None]:
        """Return the text of a token, and its owner if it has one."""
        if random.random() < 0.1:
            who = random.choice((*self.tokens, SUBJECT))
            return self.tokens.get(who, self.jwt), who
        if random.random() < 0.2:
            text = in_a_field(mutation.raw(random, random.choice(tuple(self.tokens.values())).encode()))
            return text, self.whose(text)
        if random.random() < 0.3:
            return self._signed(random)
        text = random.choice((self._forged, self._spoilt))(random, self.jwt)
        return text, self.whose(text)

    def cookie(self, random: Random) -> tuple[str, str | None]:
        """Return a Cookie field, and the owner of the session."""
        good = random.choice(tuple(self.cookies.values()))
        value = random.choice((good, self.underway, self.jwt, self._forged(random, good), self._spoilt(random, good)))
        name = random.choice((COOKIE, COOKIE, COOKIE, COOKIE, "linked-fleet", COOKIE + "-login", COOKIE.lower()))
        said = f"{name}={value}"
        if random.random() < 0.1:
            said = in_a_field(mutation.raw(random, said.encode()))
        if random.random() < 0.1:
            said = random.choice((f"{said}; {said}x", f"a=b; {said}", f"{said};;=;", f'{name}="{value}"', "; " * 200))
        return said, self.whose_session(said)

    def login_cookie(self, random: Random) -> str:
        good = self.underway
        value = random.choice((good, good, self._forged(random, good), self._spoilt(random, good)))
        return f"{COOKIE}-login={value}"

    # -- whose it is --------------------------------------------------------------------------------------------------

    def whose(self, text: str) -> str | None:
        text = text.strip()
        if _same(text, self.jwt):
            return SUBJECT
        return next((who for who, token in self.tokens.items() if token == text), None)

    def whose_session(self, said: str) -> str | None:
        value = cookie_parser(said).get(COOKIE, "")
        return next((who for who, good in self.cookies.items() if _same(value, good)), None)

    # -- changed ------------------------------------------------------------------------------------------------------

    def _signed(self, random: Random) -> tuple[str, str | None]:
        """Return a token signed by the issuer; mutated audiences, times and names may make it unacceptable."""
        key = self.issuer.keys[0]
        claims = mutation.tree(random, json.loads(_decoded(self.jwt.split(".")[1])))
        try:
            text = jwt.PyJWS().encode(mutation.dumped(claims), key.private, key.algorithm, {"kid": key.kid})
        except (ValueError, UnicodeError):
            return "", None
        return text, self._believed(claims)

    def _believed(self, claims: Any) -> str | None:
        """Return the subject, or a user of the issuer without rights."""
        if not isinstance(claims, dict) or claims.get("iss") != self.issuer.url:
            return None
        audience, groups, subject = claims.get("aud"), claims.get("groups"), claims.get("sub")
        try:
            lasts = float(claims.get("exp", 0)) > time.time() - 60
        except OverflowError:
            lasts = claims["exp"] > 0
        except (TypeError, ValueError):
            lasts = False
        ours = audience == AUDIENCE or (isinstance(audience, list) and AUDIENCE in audience)
        words = groups.split() if isinstance(groups, str) else groups if isinstance(groups, list) else []
        if not (ours and lasts and isinstance(subject, str) and subject):
            return None
        return SUBJECT if "operators" in words else "somebody"

    def _forged(self, random: Random, good: str) -> str:
        """Return a token with another signature, another algorithm, or none."""
        header, payload = (json.loads(_decoded(part)) for part in good.split(".")[:2])
        if random.random() < 0.5:
            payload = mutation.tree(random, payload)
        how = random.randrange(6)
        if how == 0:
            algorithm = random.choice(("none", "None", "NONE", "", "HS256", "RS256", None, 1, [], {}))
            return _joined({**header, "alg": algorithm}, payload, random.choice((b"", b"x", b"\0" * 64)))
        public = json.dumps(self.issuer.keys[0].public).encode()
        if how == 1:
            return self._by(random.choice((public, *_GUESSED_SECRETS)), "HS256", header, payload)
        if how == 2:
            more = {"jwk": self.stranger.public, "jku": "http://127.0.0.1:9/keys", "x5u": "http://127.0.0.1:9/x"}
            return self._by(self.stranger.private, "ES256", {**header, **more, "crit": ["jwk"]}, payload)
        if how == 3:
            return self._by(self.stranger.private, "ES256", header, payload)
        if how == 4:
            other = mutation.tree(random, {**header, "kid": self.issuer.keys[0].kid})
            return _joined(other, payload, _decoded(good.split(".")[2]))
        return _joined(header, payload, _decoded(good.split(".")[2]))

    def _by(self, key: Any, algorithm: str, header: dict[str, Any], payload: Any) -> str:
        signed = f"{_encoded(mutation.dumped(header | {'alg': algorithm}))}.{_encoded(mutation.dumped(payload))}"
        made = jwt.get_algorithm_by_name(algorithm)
        signature = made.sign(signed.encode(), key if algorithm != "HS256" else key or b"\0")
        return f"{signed}.{_encoded(signature)}"

    def _spoilt(self, random: Random, good: str) -> str:
        parts = good.split(".")
        how = random.randrange(7)
        if how < 3:
            return in_a_field(mutation.raw(random, good.encode()))
        if how == 3:
            random.shuffle(parts)
        elif how == 4:
            parts[random.randrange(3)] = random.choice(("", "e30", "bnVsbA", "W10", "MQ", "=", "é", "A" * 20_000))
        elif how == 5:
            parts[random.randrange(2)] = _encoded(b'{"a":' * 3000)
        else:
            parts = parts[: random.randrange(4)] + parts[: random.randrange(4)]
        return ".".join(parts)


def in_a_field(data: bytes) -> str:
    """Return the text that a client can send in a field, as the server reads it."""
    return _NOT_IN_A_FIELD.sub("", data.decode("latin-1"))


def _same(text: str, good: str) -> bool:
    """Return True if both have the same content and signature; base64 permits several spellings."""
    signed, _, signature = text.rpartition(".")
    of, _, by = good.rpartition(".")
    try:
        return signed == of and _decoded(signature) == _decoded(by)
    except (ValueError, UnicodeError):
        return False


def _encoded(data: bytes) -> str:
    return base64.urlsafe_b64encode(data).rstrip(b"=").decode()


def _decoded(text: str) -> bytes:
    return base64.urlsafe_b64decode(text + "=" * (-len(text) % 4))


def _joined(header: Any, payload: Any, signature: bytes) -> str:
    return ".".join((_encoded(mutation.dumped(header)), _encoded(mutation.dumped(payload)), _encoded(signature)))
