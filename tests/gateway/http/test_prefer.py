"""RFC 7240."""

from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from linked_fleet_gateway.http.fields import Prefer, parse_prefer


@pytest.mark.parametrize(
    ("header", "expected"),
    [
        (None, Prefer()),
        ("return=minimal", Prefer("minimal")),
        ('Return = "representation"; foo="a,b"', Prefer("representation")),
        ("respond-async, wait=10", Prefer(None, True, 10.0)),
        ("wait=100000", Prefer(wait_s=60.0)),
        ("wait=" + "9" * 5000, Prefer(wait_s=60.0)),
        ("wait=-1, return=everything, respond-async=no, ;;,=", Prefer()),
        ("return=minimal, return=representation", Prefer("minimal")),
        ("lenient, handling=strict", Prefer(strict=True)),
        ("handling=lenient", Prefer()),
    ],
)
def test_parse(header: str | None, expected: Prefer) -> None:
    """Known preferences count, the first of repeated ones; malformed or unknown ones are ignored."""
    assert replace(parse_prefer(header), ignored=()) == expected


@pytest.mark.parametrize(
    ("header", "ignored"),
    [
        ("return=minimal, respond-async, wait=1, dry-run, dry-run=1, handling=strict, handling=lenient", ()),
        (
            "wait=-1, return=everything;x, respond-async=no, a b",
            ("wait=-1", "return=everything;x", "respond-async=no", "a b"),
        ),
        ("unheard-of, handling=other", ("unheard-of", "handling=other")),
    ],
)
def test_unknown_and_malformed_members_are_listed(header: str, ignored: tuple[str, ...]) -> None:
    assert parse_prefer(header).ignored == ignored


@given(st.text() | st.text('return=minimal;,"\\ wait1'))
def test_any_header_is_survived(header: str) -> None:
    """No header causes a failure, or a wait of more than a minute."""
    wait_s = parse_prefer(header).wait_s
    assert wait_s is None or 0 <= wait_s <= 60


def test_parts_of_a_representation() -> None:
    """LDP 7.2: IRIs to include or to omit, as parameters of the first ``return`` only."""
    found = parse_prefer('return=representation; include="http://a http://b" ;omit=c, return=minimal; include="d"')
    assert found == Prefer("representation", include=frozenset({"http://a", "http://b"}), omit=frozenset({"c"}))
