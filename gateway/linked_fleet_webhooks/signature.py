"""Signed deliveries by the Standard Webhooks specification 1.0.0, symmetric scheme ``v1``; pure."""

import base64
import binascii
import hashlib
import hmac

PREFIX = "whsec_"
LEAST_BYTES, MOST_BYTES = 24, 64
"""Length of a secret in bytes, 192 to 512 bits."""


def signature_headers(secret: str, id: str, timestamp_s: int, body: bytes) -> dict[str, str]:
    """Return the header fields that identify a delivery and, with a secret, prove its origin.

    ``id`` is the same in every attempt, ``timestamp_s`` (Unix) is that of the attempt. Both are chosen by the gateway:
    a chosen id with a full stop could shift bytes between id, time and body. Raises as ``key``.
    """
    identity = {"webhook-id": id, "webhook-timestamp": str(timestamp_s)}
    if not secret:
        return identity
    signed = f"{id}.{timestamp_s}.".encode() + body
    digest = hmac.new(decode_secret(secret), signed, hashlib.sha256).digest()
    return {**identity, "webhook-signature": f"v1,{base64.b64encode(digest).decode()}"}


def decode_secret(secret: str) -> bytes:
    """Decode a secret such as ``whsec_MfKQ9r8GKYqrTwjUPD8ILPZIo2LaLaSw``.

    Raises ValueError, which explains the format.
    """
    # the message never contains the secret, because errors appear in logs and responses
    right = f"a secret is {PREFIX} and the base64 of {LEAST_BYTES} to {MOST_BYTES} random bytes"
    if not secret.startswith(PREFIX):
        raise ValueError(f"The secret does not begin with {PREFIX}; {right}.")
    try:
        decoded = base64.b64decode(secret.removeprefix(PREFIX), validate=True)
    except (binascii.Error, ValueError) as error:
        raise ValueError(f"The secret is not in base64; {right}.") from error
    if not LEAST_BYTES <= len(decoded) <= MOST_BYTES:
        raise ValueError(f"The secret has {len(decoded)} bytes; {right}.")
    return decoded
