"""Verification of tokens of issuers, before any of their claims is used (RFC 8725)."""

from typing import TYPE_CHECKING, Any

from linked_fleet_gateway.base.lazy_imports import Lazily
from linked_fleet_gateway.identity.keys import IssuerKeys
from linked_fleet_gateway.identity.roster import Issuer

if TYPE_CHECKING:
    import jwt
else:
    jwt = Lazily("jwt")

LEEWAY_S = 30
MOST_CHARACTERS = 16_384


class BadToken(Exception):  # noqa: N818 -- named like the other outcomes
    """The token is malformed, for another audience, or not valid now; the text says which."""


def issuer_named(text: str) -> str | None:
    """Return the unverified issuer that a token claims; None if it is not a token."""
    if len(text) > MOST_CHARACTERS or text.count(".") != 2:
        return None
    try:
        said = jwt.decode(text, options={"verify_signature": False})
    except (jwt.PyJWTError, ValueError, RecursionError):
        return None
    found = said.get("iss")
    return found if isinstance(found, str) else None


async def verified(text: str, issuer: Issuer, keys: IssuerKeys, audience: str) -> dict[str, Any]:
    """Return the claims of a token signed by ``issuer`` for ``audience``. Raises BadToken, IssuerSilent.

    The key determines the algorithm, which is always asymmetric; the header of the token must agree.
    """
    try:
        header = jwt.get_unverified_header(text)
    except (jwt.PyJWTError, ValueError, RecursionError) as error:
        raise BadToken("it is no JSON Web Token") from error
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
    return said


def expiry_ns(said: dict[str, Any]) -> int:
    """Return the wall time in ns at which verified claims expire."""
    # an int, because issuers may state times beyond the precision of a float
    return (int(said["exp"]) + LEEWAY_S) * 1_000_000_000
