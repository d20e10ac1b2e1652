"""Data that browsers store for the gateway, and the key with which gateways seal it."""

import base64
import time
from pathlib import Path

import pytest

from linked_fleet_gateway.extensions.sessions.sealed_cookie import (
    PendingLogin,
    new_session,
    open_login,
    open_session,
    seal_login,
    seal_session,
)
from linked_fleet_gateway.extensions.sessions.service import read_key
from linked_fleet_identity.rights import Claims, TokenHash

_KEY, _OTHER = b"k" * 32, b"o" * 32
_LOGIN = PendingLogin("https://id.example", "state", "nonce", "verifier", "/ur5/")
_HOUR_NS = 3600 * 10**9


def test_a_sealed_session_is_opened_with_its_key_only() -> None:
    session = new_session(TokenHash("ab" * 32), "one", time.time_ns())
    sealed = seal_session(session, _KEY)
    assert open_session(sealed, _KEY) == session
    assert open_session(sealed, _OTHER) is None
    assert open_session(sealed[:-2], _KEY) is None
    assert open_session("", _KEY) is None


def test_a_session_of_an_issuer_ends_after_a_shift() -> None:
    now_ns = time.time_ns()
    claims = Claims("https://id.example", "ada", frozenset({("groups", "operators")}), now_ns + 24 * _HOUR_NS)
    session = open_session(seal_session(new_session(claims, "one", now_ns), _KEY), _KEY)
    assert session is not None
    opened = session.credential
    assert isinstance(opened, Claims)
    assert (opened.issuer, opened.subject, opened.facts) == (claims.issuer, claims.subject, claims.facts)
    assert 0 < opened.expires_ns - now_ns <= 8 * _HOUR_NS
    assert session.ends_ns == opened.expires_ns
    assert open_session(seal_session(new_session(claims, "one", now_ns - 9 * _HOUR_NS), _KEY), _KEY) is None


def test_a_cookie_sealed_for_one_purpose_is_invalid_for_another() -> None:
    now_ns = time.time_ns()
    assert open_login(seal_login(_LOGIN, _KEY, now_ns), _KEY) == _LOGIN
    assert open_session(seal_login(_LOGIN, _KEY, now_ns), _KEY) is None
    assert open_login(seal_session(new_session(TokenHash("ab" * 32), "one", now_ns), _KEY), _KEY) is None
    assert open_login(seal_login(_LOGIN, _KEY, now_ns - _HOUR_NS), _KEY) is None


def test_a_key_may_be_in_a_file(tmp_path: Path) -> None:
    file = tmp_path / "key"
    file.write_bytes(base64.b64encode(_KEY) + b"\n")
    assert read_key(file) == _KEY
    for text in (b"", b"?", base64.b64encode(b"short")):
        file.write_bytes(text)
        with pytest.raises(ValueError, match="key"):
            read_key(file)
    with pytest.raises(ValueError, match="none"):
        read_key(tmp_path / "none")
