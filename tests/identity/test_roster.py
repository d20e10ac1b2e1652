"""The file of identities: what it says, and what it must not."""

import time
from hashlib import sha256
from pathlib import Path

import pytest

from gateway.identity.__main__ import new_token
from gateway.identity.rights import Claims, Right, TokenHash
from gateway.identity.roster import BadRoster, Roster, parse_roster, read_roster

_DIGEST = sha256(b"x").hexdigest()
_TOKEN = f'[[token]]\nname = "a"\nsha256 = "{_DIGEST}"\nscopes = ["read"]\n'
_ISSUER = '[[issuer]]\nurl = "https://id.example/realms/plant"\naudience = "fleet"\n'
_YEAR_NS = 365 * 86_400 * 10**9


def roster(text: str) -> Roster:
    return parse_roster(text, Path())


def test_a_new_token_is_known_by_its_hash_alone() -> None:
    token, toml = new_token("line-3", ["read", "act"], ["lab-*"])
    assert token not in toml and len(token) >= 43  # 256 bits
    known = roster(toml)
    proved = known.token(token)
    assert proved == TokenHash(sha256(token.encode()).hexdigest())
    who = known.identity(proved, time.time_ns())
    assert who is not None and who.name == "line-3"
    assert who.may(Right.STOP, "lab-1") and not who.may(Right.READ, "hall-1")
    for wrong in ("", token[:-1], token + "x", token.upper(), sha256(token.encode()).hexdigest(), "\ud800"):
        assert known.token(wrong) is None


def test_a_token_expires() -> None:
    known = roster(_TOKEN + "expires = 2030-01-01T00:00:00+01:00\n")
    at_ns = 1_893_452_400 * 10**9
    assert known.identity(TokenHash(_DIGEST), at_ns - 1) is not None
    assert known.identity(TokenHash(_DIGEST), at_ns) is None
    assert known.holder("a", at_ns - 1) is not None and known.holder("a", at_ns) is None


def test_what_an_issuer_says_is_held_against_the_grants() -> None:
    known = roster(
        _ISSUER
        + '[[issuer.grant]]\nscopes = ["read"]\n'
        + '[[issuer.grant]]\nclaim = "realm_access.roles"\nvalue = "operator"\nscopes = ["act"]\nrobots = ["lab-*"]\n'
        + '[[issuer.grant]]\nclaim = "https://x.example/scope"\nvalue = "fleet:admin"\nscopes = ["admin"]\n'
    )
    (issuer,) = known.issuers.values()
    claims = issuer.claims({"sub": "7", "realm_access": {"roles": ["operator", "x"]}}, _YEAR_NS)
    assert claims is not None
    who = known.identity(claims, 0)
    assert who is not None and who.name == "7@id.example"
    assert who.may(Right.ACT, "lab-1") and who.may(Right.READ, "hall") and not who.may(Right.ACT, "hall")
    assert known.identity(claims, _YEAR_NS) is None
    said = issuer.claims({"sub": "8", "https://x.example/scope": "openid fleet:admin"}, _YEAR_NS)
    other = known.identity(said, 0)
    assert other is not None and other.may(Right.ADMIN, None) and not other.may(Right.ACT, "lab-1")
    assert roster(_TOKEN).identity(claims, 0) is None  # the issuer is in the file no more


@pytest.mark.parametrize("said", [{}, {"sub": 7}, {"sub": ""}, {"sub": "a\nb"}, {"sub": "x" * 256}])
def test_who_has_no_name_is_nobody(said: dict[str, object]) -> None:
    (issuer,) = roster(_ISSUER).issuers.values()
    assert issuer.claims(said, _YEAR_NS) is None


def test_a_name_of_an_issuer_is_none_of_a_token() -> None:
    """Whoever may choose his name at an issuer does not become who holds a token."""
    (issuer,) = roster(_ISSUER).issuers.values()
    claims = Claims(issuer.url, "a", frozenset(), _YEAR_NS)
    who = roster(_ISSUER + _TOKEN).identity(claims, 0)
    assert who is not None and who.name != "a"


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("[[token", "array"),
        (_TOKEN.replace('"read"', '"reed"'), "reed"),
        (_TOKEN.replace('["read"]', "[]"), "scopes"),
        (_TOKEN.replace(_DIGEST, _DIGEST.upper()), "sha256"),
        (_TOKEN.replace('"a"', '"a@b"'), "a@b"),
        (_TOKEN + "expires = 2030-01-01T00:00:00\n", "offset"),
        (_TOKEN + 'robot = ["x"]\n', "robot"),
        (_TOKEN + "robots = []\n", "patterns"),
        (_TOKEN + _TOKEN, "two tokens"),
        (_TOKEN + _TOKEN.replace('"a"', '"b"'), "sha256"),
        (_ISSUER.replace("https", "http"), "https"),
        (_ISSUER.replace('"fleet"', '""'), "audience"),
        (_ISSUER + 'client_secret_file = "not-there"\n', "not-there No such file"),
        (_ISSUER + _ISSUER.replace("plant", "other"), "two issuers"),
        ("tokens = []", "tokens"),
    ],
)
def test_a_bad_file_is_one_clear_line(tmp_path: Path, text: str, said: str) -> None:
    file = tmp_path / "identities.toml"
    file.write_text(text)
    with pytest.raises(BadRoster) as error:
        read_roster(file)
    assert said in str(error.value) and "identities.toml" in str(error.value) and "\n" not in str(error.value)


def test_no_file_is_a_bad_file(tmp_path: Path) -> None:
    with pytest.raises(BadRoster, match="No such file"):
        read_roster(tmp_path / "none.toml")
