"""The escape: every name has exactly one segment, and only that one."""

import re

import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from linked_fleet_agent.wire.keys import MAX_NAME_BYTES, escape, unescape

RESERVED = frozenset({"subscriptions", "jointState", "health", "-"})
names = st.text(st.characters(exclude_categories=["Cs"]), min_size=1).filter(
    lambda name: len(name.encode()) <= MAX_NAME_BYTES
)


@given(names)
def test_a_name_comes_back(name: str) -> None:
    assert unescape(escape(name)) == name
    assert unescape(escape(name, RESERVED), RESERVED) == name


@given(names)
def test_a_segment_is_safe_in_a_uri_and_in_a_key(name: str) -> None:
    segment = escape(name, RESERVED)
    assert re.fullmatch(r"[A-Za-z0-9_.~-]+", segment)
    assert segment not in {".", "..", *RESERVED}


@given(names, names)
def test_two_names_never_share_a_segment(one: str, other: str) -> None:
    assume(one != other)
    assert escape(one, RESERVED) != escape(other, RESERVED)


@given(st.text() | st.text("~09AFaf.-x"))
def test_accepted_names_are_canonical(segment: str) -> None:
    try:
        name = unescape(segment)
    except ValueError:
        return
    assert escape(name) == segment


@pytest.mark.parametrize("name", sorted(RESERVED))
def test_a_reserved_name_gets_another_segment(name: str) -> None:
    assert escape(name, RESERVED) == f"~{ord(name[0]):02X}{name[1:]}"
    with pytest.raises(ValueError, match="not the segment"):
        unescape(name, RESERVED)


@pytest.mark.parametrize(
    "segment", ["", ".", "..", "a b", "a/b", "~", "~2", "~2e.", "~61", "~ff", "~FF", "~C3", "ä", "~+1"]
)
def test_other_spellings_are_refused(segment: str) -> None:
    with pytest.raises(ValueError, match="not the segment of a name"):
        unescape(segment)


@pytest.mark.parametrize("name", ["", "x" * 129, "ä" * 65, "\ud800"])
def test_invalid_names_have_no_segment(name: str) -> None:
    with pytest.raises(ValueError):
        escape(name)
