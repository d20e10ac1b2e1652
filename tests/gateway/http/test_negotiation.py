"""RFC 9110, 12.5.1 and 8.3."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from linked_fleet_base.errors import BadRequest, UnsupportedMediaType
from linked_fleet_gateway.http.negotiation import choose, parse_accept, parse_content_type

OFFERED = ("text/turtle", "application/ld+json", "application/n-triples", "application/rdf+xml", "text/html")
BROWSER = "text/html,application/xhtml+xml,application/xml;q=0.9,*/*;q=0.8"


@pytest.mark.parametrize(
    ("accept", "chosen"),
    [
        (None, "text/turtle"),
        ("", "text/turtle"),
        ("*/*", "text/turtle"),
        (BROWSER, "text/html"),
        ("application/ld+json", "application/ld+json"),
        ("APPLICATION/LD+JSON", "application/ld+json"),
        ("text/turtle;q=0.5, application/ld+json;q=0.6", "application/ld+json"),
        ("text/html, text/turtle", "text/turtle"),
        ("text/*;q=0.5, text/turtle;q=0, */*;q=0.1", "text/html"),
        ("text/turtle;q=0, */*", "application/ld+json"),
        ("text/turtle;q=0.1, */*;q=0.5", "application/ld+json"),
        ("text/turtle;charset=UTF-8", "text/turtle"),
        ("text/turtle;charset=latin-1", None),
        ("text/turtle;version=1.2", "text/turtle"),
        ("application/n-triples;version=1.1;charset=utf-8, text/html;q=0.5", "application/n-triples"),
        ("image/png", None),
        ("*/*;q=0", None),
        ("text/turtle;q=2, text/html", "text/html"),
        ("oops, ;, text/, /html, */html, text/html;q=0.3", "text/html"),
        ('text/turtle;x="a,b;q=0", text/html;q=0.1', "text/html"),
        ("oops", "text/turtle"),
    ],
)
def test_choose(accept: str | None, chosen: str | None) -> None:
    """The most specific range weighs each type; the server's order decides ties; malformed members are ignored."""
    assert choose(accept, OFFERED) == chosen


@pytest.mark.parametrize(
    ("accept", "taken"), [("header=present", True), ("charset=UTF-8; header=present", True), ("header=absent", False)]
)
def test_all_csv_has_a_header_line(accept: str, taken: bool) -> None:
    """RFC 4180, 3."""
    assert (choose(f"text/csv; {accept}", ("application/json", "text/csv")) == "text/csv") is taken


@given(st.text() | st.text('*/;,q=.01"\\ textrl-'))
def test_any_header_is_survived(header: str) -> None:
    """No header makes negotiation fail, and every weight is valid."""
    assert all(0 <= media_range.q <= 1 for media_range in parse_accept(header))
    assert choose(header, OFFERED) in (None, *OFFERED)


def test_content_type() -> None:
    """Type in lower case, parameters unquoted."""
    assert parse_content_type('Text/Turtle; Charset="UTF-8"') == ("text/turtle", {"charset": "UTF-8"})


@pytest.mark.parametrize("header", [None, "", "text/turtle; charset=latin-1", "image/png"])
def test_content_type_refused(header: str | None) -> None:
    """Missing types, other charsets and other types get 415 that lists what is accepted."""
    with pytest.raises(UnsupportedMediaType) as caught:
        parse_content_type(header, OFFERED)
    assert caught.value.headers["Accept"].startswith("text/turtle")


@pytest.mark.parametrize("header", ["turtle", "text/", "text/turtle; charset", "a b/c"])
def test_content_type_malformed(header: str) -> None:
    """An invalid media type gets 400."""
    with pytest.raises(BadRequest):
        parse_content_type(header)
