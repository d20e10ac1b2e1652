"""Deliveries can be verified with any Standard Webhooks library."""

import base64

import pytest
from hypothesis import given
from hypothesis import strategies as st

from linked_fleet_webhooks.signature import decode_secret, signature_headers

SECRET = "whsec_MfKQ9r8GKYqrTwjUPD8ILPZIo2LaLaSw"


def test_the_vector_of_the_reference_libraries_comes_out() -> None:
    signed = signature_headers(SECRET, "msg_p5jXN8AQM9LWM0D4loKWxJek", 1614265330, b'{"test": 2432232314}')
    assert signed == {
        "webhook-id": "msg_p5jXN8AQM9LWM0D4loKWxJek",
        "webhook-timestamp": "1614265330",
        "webhook-signature": "v1,g0hM9SsE+OTPJTGt/tmIKtSyZlE3uFJELVlNIOLJ1OE=",
    }


def test_without_a_secret_there_is_no_signature() -> None:
    assert signature_headers("", "a", 1, b"body") == {"webhook-id": "a", "webhook-timestamp": "1"}


@pytest.mark.parametrize("changed", [("b", 1, b"body"), ("a", 2, b"body"), ("a", 1, b"bodY")])
def test_id_time_and_body_are_all_signed(changed: tuple[str, int, bytes]) -> None:
    assert (
        signature_headers(SECRET, *changed)["webhook-signature"]
        != signature_headers(SECRET, "a", 1, b"body")["webhook-signature"]
    )


@given(st.binary(min_size=24, max_size=64))
def test_a_secret_of_any_24_to_64_bytes_is_taken(random: bytes) -> None:
    assert decode_secret("whsec_" + base64.b64encode(random).decode()) == random


@pytest.mark.parametrize(
    ("secret", "fault"),
    [
        ("MfKQ9r8GKYqrTwjUPD8ILPZIo2LaLaSw", "does not begin with whsec_"),
        ("WHSEC_MfKQ9r8GKYqrTwjUPD8ILPZIo2LaLaSw", "does not begin with whsec_"),
        ("whsec_", "has 0 bytes"),
        ("whsec_" + base64.b64encode(bytes(23)).decode(), "has 23 bytes"),
        ("whsec_" + base64.b64encode(bytes(65)).decode(), "has 65 bytes"),
        ("whsec_MfKQ9r8GKYqrTwjUPD8ILPZIo2LaLaS", "not in base64"),
        ("whsec_MfKQ9r8GKYqrTwjUPD8ILPZIo2LaLaS-", "not in base64"),
        ("whsec_MfKQ9r8GKYqrTwjUPD8ILPZIo2LaLaSw\n", "not in base64"),
        ("whsec_MfKQ9r8GKYqrTwjUPD8ILPZIo2LaLaSä", "not in base64"),
    ],
)
def test_other_secrets_are_refused_without_being_repeated(secret: str, fault: str) -> None:
    with pytest.raises(ValueError, match=fault) as refused:
        decode_secret(secret)
    assert "24 to 64 random bytes" in str(refused.value)
    assert "MfKQ9r8G" not in str(refused.value)
