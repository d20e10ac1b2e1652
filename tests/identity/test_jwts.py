"""Tokens of a real issuer: what is refused, and how keys are found (RFC 8725)."""

import asyncio
import json
import time
from base64 import urlsafe_b64encode
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import jwt
import pytest
from cryptography.hazmat.primitives.serialization import Encoding, PublicFormat

import linked_fleet_identity.issuers as identity_keys
from issuer import AUDIENCE, Issuer, Key, issuing
from linked_fleet_identity.issuers import (
    BadToken,
    IssuerFailed,
    IssuerKeys,
    Web,
    claimed_issuer,
    expiry_ns,
    verify_token,
)
from linked_fleet_identity.roster import parse_roster

pytestmark = pytest.mark.virtual


@pytest.fixture
def issuer() -> Iterator[Issuer]:
    with issuing() as one:
        yield one


def claims_of(issuer: Issuer, *tokens: str) -> list[dict[str, Any] | str]:
    """Return the claims of each token, or why it is refused; one after another, with the same keys."""

    async def read() -> list[dict[str, Any] | str]:
        web, found = Web(), []
        keys = IssuerKeys(web, issuer.url)
        (known,) = parse_roster(f'[[issuer]]\nurl = "{issuer.url}"\naudience = "{AUDIENCE}"\n', Path()).issuers.values()
        for token in tokens:
            try:
                found.append(await verify_token(token, known, keys, AUDIENCE))
            except BadToken as error:
                found.append(str(error))
        await web.aclose()
        return found

    return asyncio.run(read())


@pytest.mark.parametrize("algorithm", ["ES256", "RS256", "EdDSA"])
def test_a_token_of_the_issuer_is_believed(issuer: Issuer, algorithm: str) -> None:
    issuer.keys = [Key("k", algorithm)]
    (said,) = claims_of(issuer, issuer.token())
    assert isinstance(said, dict) and said["sub"] == "ada"


@pytest.mark.parametrize("exp", [10**400, float("inf"), float("nan"), [], {}, True, "never"])
def test_an_odd_end_is_far_away_or_none(issuer: Issuer, exp: object) -> None:
    """An issuer may send anything: no number is too large, and anything else is refused."""
    (said,) = claims_of(issuer, issuer.token(exp=exp))
    if exp == 10**400:
        assert isinstance(said, dict) and expiry_ns(said) > time.time_ns()
    else:
        assert isinstance(said, str)


def test_invalid_tokens_are_refused(issuer: Issuer) -> None:
    now_s = int(time.time())
    refused = {
        "wrong key": issuer.token(Key("first")),
        "wrong audience": issuer.token(aud="another"),
        "wrong issuer": issuer.token(iss=issuer.url + "/other"),
        "expired": issuer.token(exp=now_s - 31),
        "not yet": issuer.token(nbf=now_s + 40),
        "without end": issuer.token(exp=None),
        "without audience": issuer.token(aud=None),
        "unknown key": issuer.token(Key("second")),
        "no algorithm": jwt.encode({"sub": "ada", "iss": issuer.url, "aud": AUDIENCE, "exp": now_s + 9}, "", "none"),
        "end as a string": issuer.token(exp=str(now_s + 60)),
        "start as a string": issuer.token(nbf=str(now_s - 60)),
        "time of issue as a string": issuer.token(iat=str(now_s - 60)),
        "a security event": issuer.token(events={"http://schemas.openid.net/event/backchannel-logout": {}}),
        "no token": "a.b.c",
        "nothing": "",
    }
    for what, said in zip(refused, claims_of(issuer, *refused.values()), strict=True):
        assert isinstance(said, str), what


@pytest.mark.parametrize(
    ("typ", "believed"),
    [
        (None, True), ("JWT", True), ("jwt", True), ("at+jwt", True), ("application/at+JWT", True),
        ("logout+jwt", False), ("dpop+jwt", False), ("secevent+jwt", False), ("application/logout+jwt", False),
    ],
)  # fmt: skip
def test_a_token_of_another_type_is_no_credential(issuer: Issuer, typ: str | None, believed: bool) -> None:
    """RFC 8725, 3.11."""
    (said,) = claims_of(issuer, issuer.token(typ=typ))
    assert isinstance(said, dict) is believed


def test_clocks_may_differ_by_half_a_minute(issuer: Issuer) -> None:
    now_s = int(time.time())
    for said in claims_of(issuer, issuer.token(exp=now_s - 20), issuer.token(nbf=now_s + 20)):
        assert isinstance(said, dict)


def test_no_algorithm_is_taken_from_the_header(issuer: Issuer) -> None:
    """A public key is no shared secret (RFC 8725, 2.1), nor a key of another type or size than stated."""
    issuer.keys = [Key("rsa", "RS256")]
    public = issuer.keys[0].private.public_key().public_bytes(Encoding.PEM, PublicFormat.SubjectPublicKeyInfo)
    body = {"iss": issuer.url, "aud": AUDIENCE, "sub": "eve", "exp": int(time.time()) + 60}
    forged = _by_hand({"alg": "HS256", "kid": "rsa"}, body, public)
    none = _by_hand({"alg": "none", "kid": "rsa"}, body, b"")
    other = issuer.token(algorithm="RS512")
    said = claims_of(issuer, forged, none, none.rpartition(".")[0] + ".", other)
    assert all(isinstance(each, str) for each in said), said


def _by_hand(header: dict[str, str], body: dict[str, Any], secret: bytes) -> str:
    """Sign by hand, since libraries refuse to sign like this."""
    import hmac

    parts = [urlsafe_b64encode(json.dumps(each).encode()).rstrip(b"=") for each in (header, body)]
    signature = hmac.digest(secret, b".".join(parts), "sha256")
    return b".".join([*parts, urlsafe_b64encode(signature).rstrip(b"=")]).decode()


def test_keys_for_other_purposes_are_none(issuer: Issuer) -> None:
    issuer.keys = [Key("e"), Key("good")]
    issuer.keys[0].public["use"] = "enc"
    shared = Key("s")
    shared.public = {"kty": "oct", "k": "c2VjcmV0", "kid": "s", "alg": "HS256"}
    issuer.keys.append(shared)
    said = claims_of(
        issuer, issuer.token(issuer.keys[0]), issuer.token(shared, algorithm="HS256", secret="secret" * 9),
        issuer.token(issuer.keys[1]),
    )  # fmt: skip
    assert [isinstance(each, dict) for each in said] == [False, False, True]


def test_a_new_key_is_found_and_an_unknown_one_asked_for_rarely(
    issuer: Issuer, monkeypatch: pytest.MonkeyPatch
) -> None:
    old, new = issuer.token(), Key("next")
    unknown = [issuer.token(Key(f"unknown{n}")) for n in range(5)]
    said = claims_of(issuer, old, *unknown)
    assert isinstance(said[0], dict) and issuer.fetched == 1  # half a minute is not over
    monkeypatch.setattr(identity_keys, "RETRY_S", 0.0)
    issuer.keys.append(new)
    first, second = claims_of(issuer, old, issuer.token(new))
    assert isinstance(first, dict) and isinstance(second, dict)
    monkeypatch.setattr(identity_keys, "STALE_S", 0.0)
    issuer.keys = [new]
    assert isinstance(claims_of(issuer, old)[0], str)  # withdrawn


def test_an_issuer_that_calls_itself_otherwise_is_none(issuer: Issuer) -> None:
    token, url = issuer.token(), issuer.url
    issuer.url = "https://elsewhere.example"

    async def read() -> None:
        web = Web()
        try:
            await IssuerKeys(web, url).find("first")
        finally:
            await web.aclose()

    with pytest.raises(IssuerFailed, match="elsewhere"):
        asyncio.run(read())
    assert claimed_issuer(token) == url


@pytest.mark.parametrize("text", ["", "..", "a.b.c", "x" * 20_000, "e30.e30.", "W10.W10.x", "é.é.é"])
def test_no_text_is_too_strange_to_look_at(text: str) -> None:
    assert claimed_issuer(text) is None


async def test_a_known_key_waits_for_nobody(issuer: Issuer, monkeypatch: pytest.MonkeyPatch) -> None:
    """An unreachable issuer delays no request and removes no right, though its keys are due for a refresh."""
    monkeypatch.setattr(identity_keys, "STALE_S", 0.0)
    monkeypatch.setattr(identity_keys, "RETRY_S", 0.0)
    web = Web()
    keys = IssuerKeys(web, issuer.url)
    assert await keys.find("first") is not None
    issuer.silent = True
    for _ in range(3):
        assert await asyncio.wait_for(keys.find("first"), 2) is not None
    issuer.release()
    await keys.aclose()
    await web.aclose()
