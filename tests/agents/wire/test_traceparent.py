"""Valid and invalid traceparent fields (W3C Trace Context, 3.2)."""

import re
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from linked_fleet_agent.wire import traceparent
from linked_fleet_agent.wire.traceparent import TraceParent

TRACE, SPAN = "0af7651916cd43dd8448eb211c80319c", "b7ad6b7169203331"


@given(st.integers(1, 2**128 - 1), st.integers(1, 2**64 - 1), st.booleans())
def test_a_written_traceparent_is_parsed(trace_id: int, span_id: int, sampled: bool) -> None:
    parent = TraceParent(trace_id, span_id, sampled)
    assert traceparent.parse(str(parent)) == parent
    assert len(str(parent)) == 55


def test_only_the_flag_that_is_known_is_read() -> None:
    for flags, sampled in (("00", False), ("01", True), ("02", False), ("ff", True)):
        parent = traceparent.parse(f"00-{TRACE}-{SPAN}-{flags}")
        assert parent == TraceParent(int(TRACE, 16), int(SPAN, 16), sampled)


def test_a_later_version_is_read_as_far_as_it_is_known() -> None:
    for later in (f"01-{TRACE}-{SPAN}-01", f"cc-{TRACE}-{SPAN}-01-what-comes-then"):
        parent = traceparent.parse(later)
        assert str(parent) == f"00-{TRACE}-{SPAN}-01"


@pytest.mark.parametrize(
    "text",
    [
        "",
        f"00-{TRACE}-{SPAN}",
        f"00-{TRACE}-{SPAN}-01-more",
        f"00-{TRACE}-{SPAN}-01\n",
        f" 00-{TRACE}-{SPAN}-01",
        f"ff-{TRACE}-{SPAN}-01",
        f"01-{TRACE}-{SPAN}-01.more",
        f"00-{TRACE.upper()}-{SPAN}-01",
        f"00-{'0' * 32}-{SPAN}-01",
        f"00-{TRACE}-{'0' * 16}-01",
        f"00-{TRACE}-{SPAN}-0١",
        f"01-{TRACE}-{SPAN}-01-" + "x" * 256,
    ],
)
def test_anything_else_is_none(text: str) -> None:
    assert traceparent.parse(text) is None


@given(st.binary(max_size=300))
def test_no_bytes_raise(data: bytes) -> None:
    assert traceparent.parse(data.decode("latin-1")) is None


def test_the_example_in_the_page_is_one() -> None:
    page = (Path(traceparent.__file__).parent / "PROTOCOL.md").read_text()
    (example,) = re.findall(r"`(00-[0-9a-f-]+)`", page)
    assert str(traceparent.parse(example)) == example
    assert f"{traceparent.MAX_BYTES} bytes" in page
