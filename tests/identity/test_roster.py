"""The file of identities: valid and invalid contents."""

import time
from hashlib import sha256
from pathlib import Path

import pytest

from linked_fleet_identity.__main__ import new_token
from linked_fleet_identity.rights import Claims, Right, TokenHash
from linked_fleet_identity.roster import BadRoster, Issuer, Roster, parse_roster, read_roster

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
    assert who.has_right(Right.STOP, "lab-1") and not who.has_right(Right.READ, "hall-1")
    for wrong in ("", token[:-1], token + "x", token.upper(), sha256(token.encode()).hexdigest(), "\ud800"):
        assert known.token(wrong) is None


def test_a_token_expires() -> None:
    known = roster(_TOKEN + "expires = 2030-01-01T00:00:00+01:00\n")
    at_ns = 1_893_452_400 * 10**9
    assert known.identity(TokenHash(_DIGEST), at_ns - 1) is not None
    assert known.identity(TokenHash(_DIGEST), at_ns) is None
    assert known.holder("a", at_ns - 1) is not None and known.holder("a", at_ns) is None
    assert known.holder("b", at_ns - 1) is None


def test_claims_are_matched_with_grants() -> None:
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
    assert (
        who.has_right(Right.ACT, "lab-1") and who.has_right(Right.READ, "hall") and not who.has_right(Right.ACT, "hall")
    )
    assert known.identity(claims, _YEAR_NS) is None
    said = issuer.claims({"sub": "8", "https://x.example/scope": "openid fleet:admin"}, _YEAR_NS)
    other = known.identity(said, 0)
    assert other is not None and other.has_right(Right.ADMIN, None) and not other.has_right(Right.ACT, "lab-1")
    assert roster(_TOKEN).identity(claims, 0) is None  # the issuer is no longer in the file


@pytest.mark.parametrize("said", [{}, {"sub": 7}, {"sub": ""}, {"sub": "a\nb"}, {"sub": "x" * 256}])
def test_claims_without_a_name_are_refused(said: dict[str, object]) -> None:
    (issuer,) = roster(_ISSUER).issuers.values()
    assert issuer.claims(said, _YEAR_NS) is None


def test_a_subject_has_at_most_255_characters() -> None:
    (issuer,) = roster(_ISSUER).issuers.values()
    assert issuer.claims({"sub": "x" * 255}, _YEAR_NS) == Claims(issuer.url, "x" * 255, frozenset(), _YEAR_NS)


def test_claims_can_be_looked_up_again() -> None:
    """A session keeps the claims, and looks them up again when the file has changed."""
    known = roster(_ISSUER)
    claims = Claims("https://id.example/realms/plant", "7", frozenset(), _YEAR_NS)
    who = known.identity(claims, 0)
    assert who is not None and (who.credential, who.expires_ns) == (claims, _YEAR_NS)


@pytest.mark.parametrize(
    ("scope", "granted"),
    [
        ("fleet:read", True),
        ("openid fleet:read x", True),
        ("fleet:reader", False),
        ("", False),
        (["openid", "fleet:read"], True),
        (["fleet:read openid"], False),
        ({"fleet:read": True}, False),
        (7, False),
        (None, False),
    ],
)
def test_a_grant_asks_for_a_whole_value_of_a_claim(scope: object, granted: bool) -> None:
    """A word of a string, or a member of a list."""
    known = roster(_ISSUER + '[[issuer.grant]]\nclaim = "scope"\nvalue = "fleet:read"\nscopes = ["read"]\n')
    (issuer,) = known.issuers.values()
    who = known.identity(issuer.claims({"sub": "7", "scope": scope}, _YEAR_NS), 0)
    assert who is not None and who.has_right(Right.READ, "ur5") is granted


def test_a_claim_without_a_value_is_held_against_the_empty_one() -> None:
    """A grant with a claim but without a value must not apply to everybody."""
    known = roster(_ISSUER + '[[issuer.grant]]\nclaim = "role"\nscopes = ["read"]\n')
    (issuer,) = known.issuers.values()
    for said, granted in (({}, False), ({"role": "operator"}, False), ({"role": ""}, True)):
        who = known.identity(issuer.claims({"sub": "7", **said}, _YEAR_NS), 0)
        assert who is not None and who.has_right(Right.READ, "ur5") is granted


def test_an_issuer_is_what_the_file_says(tmp_path: Path) -> None:
    (tmp_path / "secret").write_text("s3cret\n")
    text = _ISSUER + 'name = "plant"\nname_claim = "email"\nclient_id = "gateway"\nclient_secret_file = "secret"\n'
    (issuer,) = parse_roster(text, tmp_path).issuers.values()
    url = "https://id.example/realms/plant"
    assert issuer == Issuer(url, "fleet", "plant", "email", "gateway", "s3cret", ())
    (other,) = roster(_ISSUER).issuers.values()
    assert other == Issuer(url, "fleet", "id.example", "sub", "", "", ())


@pytest.mark.parametrize("host", ["localhost", "localhost:8080", "127.0.0.1", "127.9.9.9:1", "[::1]:8080"])
def test_an_issuer_on_this_machine_needs_no_tls(host: str) -> None:
    """An IPv6 address is no name, so such an issuer needs TLS."""
    text = _ISSUER.replace("https://id.example", f"http://{host}") + 'name = "here"\n'
    assert list(roster(text).issuers) == [f"http://{host}/realms/plant"]


@pytest.mark.parametrize("scope", Right)
def test_a_token_may_have_each_right(scope: Right) -> None:
    (who,) = roster(_TOKEN.replace("read", scope)).tokens.values()
    assert who.has_right(scope, "ur5")


@pytest.mark.parametrize("name", ["a", "Z9._-", "x" * 64])
def test_the_name_of_a_token_has_letters_of_both_cases(name: str) -> None:
    assert [who.name for who in roster(_TOKEN.replace('"a"', f'"{name}"')).tokens.values()] == [name]


def test_a_file_has_at_most_4_mib(tmp_path: Path) -> None:
    file, most = tmp_path / "identities.toml", 4 * 2**20
    file.write_text((_TOKEN + "#").ljust(most, "x"))
    assert list(read_roster(file).tokens) == [_DIGEST]
    file.write_text((_TOKEN + "#").ljust(most + 1, "x"))
    with pytest.raises(BadRoster) as error:
        read_roster(file)
    assert str(error.value) == f"{file}: the file is longer than {most} bytes"


def test_a_name_of_an_issuer_is_none_of_a_token() -> None:
    """Somebody who can choose a name at an issuer does not become the owner of a token."""
    (issuer,) = roster(_ISSUER).issuers.values()
    claims = Claims(issuer.url, "a", frozenset(), _YEAR_NS)
    who = roster(_ISSUER + _TOKEN).identity(claims, 0)
    assert who is not None and who.name != "a"


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("[[token", "array"),
        (_TOKEN.replace('"read"', '"reed"'), "reed"),
        (
            _TOKEN.replace('["read"]', "[]"),
            "token a needs at least one of the scopes read, subscribe, stop, act, person, reset, admin",
        ),
        (_TOKEN.replace(_DIGEST, _DIGEST.upper()), "sha256"),
        (_TOKEN.replace('"a"', '"a@b"'), "a@b"),
        (_TOKEN.replace('"a"', f'"{"x" * 65}"'), "1 to 64"),
        (_TOKEN + "expires = 2030-01-01T00:00:00\n", "offset"),
        (_TOKEN + 'robot = ["x"]\n', "robot"),
        (_TOKEN + "robots = []\n", "patterns"),
        (_TOKEN + 'robots = ["lab-*", ""]\n', "patterns"),
        (_TOKEN + _TOKEN, "two tokens are called 'a'"),
        (_TOKEN + _TOKEN.replace('"a"', '"b"'), f"two tokens have the sha256 '{_DIGEST}'"),
        (_ISSUER.replace("https", "http"), "https"),
        (_ISSUER.replace("https", "ftp").replace("id.example", "localhost"), "https"),
        (_ISSUER.replace("https://id.example", "http:"), "https"),
        (_ISSUER.replace("https://id.example", "https:"), "the name of an issuer"),
        (_ISSUER + 'name = "a@b"\n', "the name of an issuer has 1 to 64"),
        (_ISSUER + 'clientid = "x"\n', "clientid"),
        (_ISSUER + "[[issuer.grant]]\nscopes = []\n", "a grant of issuer id.example needs"),
        (_ISSUER.replace('"fleet"', '""'), "audience"),
        (_ISSUER + 'client_secret_file = "not-there"\n', "not-there No such file"),
        (_ISSUER + _ISSUER.replace("plant", "other"), "two issuers are called 'id.example'"),
        (_ISSUER + 'name = "a"\n' + _ISSUER, "two issuers have the url 'https://id.example/realms/plant'"),
        ("tokens = []", "tokens"),
    ],
)
def test_a_bad_file_is_one_clear_line(tmp_path: Path, text: str, said: str) -> None:
    file = tmp_path / "identities.toml"
    file.write_text(text)
    with pytest.raises(BadRoster) as error:
        read_roster(file)
    assert said in str(error.value) and str(error.value).count(str(file)) == 1 and "\n" not in str(error.value)


def test_no_file_is_a_bad_file(tmp_path: Path) -> None:
    file = tmp_path / "none.toml"
    with pytest.raises(BadRoster) as error:
        read_roster(file)
    assert str(error.value) == f"{file}: No such file or directory"
