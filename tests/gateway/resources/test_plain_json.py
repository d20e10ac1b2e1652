"""Plain JSON bodies without a counterpart in a form."""

import pytest

from linked_fleet_base.errors import BadRequest, PayloadTooLarge
from linked_fleet_gateway.resources.json_form import form_of
from linked_fleet_gateway.resources.plain_json import parse_json_body
from linked_fleet_rdf.vocabulary import LF

IRI = "http://127.0.0.1:8000/arm/title"


@pytest.mark.parametrize(
    ("body", "message"),
    [
        (b'{"value": "\\ud800"}', r"\\ud800 is half of a surrogate pair"),
        (b'{"\\udc00": "x"}', r"\\udc00 is half of a surrogate pair"),
        (b'{"value": "x", "value": "y"}', "two members of the same name"),
        (b"[" * 40 + b"]" * 40, "nested more than 16"),
        (b'{"value": [' + b"1," * 400 + b"1]}", "more than 400 commas and opening brackets"),
        (b'{"value": NaN}', "NaN is not JSON"),
        (b'{"value": "\xff"}', "not UTF-8"),
    ],
)  # fmt: skip
def test_json_that_no_text_or_tree_can_hold_is_malformed(body: bytes, message: str) -> None:
    """Each gets 400 with the reason; nothing of it reaches a log or a response that must be encoded."""
    with pytest.raises(BadRequest, match=message) as caught:
        parse_json_body(body, form_of(LF.TextInput), IRI, 100)
    caught.value.detail.encode()


def test_json_of_too_many_triples_is_too_large() -> None:
    """413, as for RDF: no schema limits the total number."""
    with pytest.raises(PayloadTooLarge, match="more than 1 things"):
        parse_json_body(b'{"holder": "x", "duration": 60}', form_of(LF.ControlLeaseInput), IRI, 1)
