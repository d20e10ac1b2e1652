"""RFC 9110, 13.1."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from linked_fleet_gateway.http.negotiation import coded_tag
from linked_fleet_gateway.http.representation import etag, names_state, not_modified, precondition_holds

TAG = etag(b"body")


@given(st.binary(), st.binary())
def test_etags_tell_bodies_apart(one: bytes, other: bytes) -> None:
    """Equal bodies have equal tags, and different bodies different ones."""
    assert (etag(one) == etag(other)) == (one == other) and not_modified(etag(one), etag(one))


@pytest.mark.parametrize(
    ("header", "expected"),
    [
        (None, False),
        (TAG, True),
        ("W/" + TAG, True),
        ("*", True),
        (f'"a,b", {TAG}', True),
        (f'W/"x" , W/{TAG}', True),
        ('"x"', False),
        ("", False),
        (TAG.strip('"'), False),
        (f"{TAG} {TAG}", False),
        (f"x, {TAG}", False),
    ],
)
def test_not_modified(header: str | None, expected: bool) -> None:
    """Weak comparison over the list; a malformed list gives the full response."""
    assert not_modified(header, TAG) is expected


@pytest.mark.parametrize(
    ("header", "expected"),
    [
        (None, True),
        ("*", True),
        (TAG, True),
        (f'"x", {TAG}', True),
        ("W/" + TAG, False),
        ('"x"', False),
        ("", False),
        ("oops", False),
    ],
)
def test_precondition(header: str | None, expected: bool) -> None:
    """Strong comparison with the tag of any representation; a malformed list matches nothing."""
    assert precondition_holds(header, [etag(b"other"), TAG]) is expected


@pytest.mark.parametrize("coding", ["gzip", "br"])
def test_a_read_compares_the_coding_and_a_write_does_not(coding: str) -> None:
    coded = coded_tag(TAG, coding)
    assert [not_modified(each, coded) for each in (TAG, coded, f"W/{coded}")] == [False, True, True]
    assert [not_modified(each, TAG) for each in (TAG, coded)] == [True, False]
    assert all(precondition_holds(each, [TAG]) and names_state(each, TAG) for each in (TAG, coded))
    assert names_state("*", TAG) and not names_state(None, TAG) and not names_state('"x"', TAG)


def test_precondition_without_resource() -> None:
    """``*`` requires that the resource exists."""
    assert not precondition_holds("*", [], exists=False)


def test_long_hostile_list_is_quick() -> None:
    """A list of thousands of half tags costs one pass."""
    assert not not_modified('"a" ' * 20000 + "x", TAG)
