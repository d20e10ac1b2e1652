"""Queries of histories: their meaning, and invalid ones."""

from urllib.parse import parse_qsl

import pytest
from hypothesis import given
from hypothesis import strategies as st

from linked_fleet_base.errors import BadRequest
from linked_fleet_gateway.extensions.history.span import MOST, Span, lexical_time, parse_span, query

S = 1_000_000_000


@pytest.mark.parametrize(
    ("said", "span"),
    [
        ([], Span()),
        ([("as", "csv"), ("limit", "7")], Span(limit=7)),
        ([("from", "1970-01-01T00:00:01.5Z"), ("to", "1970-01-01T01:00:02+01:00")], Span(S + S // 2, 2 * S)),
        ([("to", "1970-01-01T01:00:02 01:00")], Span(end_ns=2 * S)),
        ([("last", "PT1M10.25S")], Span(last_ns=70 * S + S // 4)),
        ([("last", "PT1M"), ("every", "PT0.5S")], Span(last_ns=60 * S, every_ns=S // 2)),
        ([("last", "P1DT1H")], Span(last_ns=25 * 3600 * S)),
        ([("last", "P1Y")], Span(last_ns=366 * 86_400 * S)),
        ([("last", "P1M1DT1M")], Span(last_ns=(32 * 86_400 + 60) * S)),
        ([("from", "1970-01-01T24:00:00Z")], Span(86_400 * S)),
        ([("from", "1970-01-31T24:00:00.000-01:00")], Span((31 * 86_400 + 3600) * S)),
        ([("to", "1970-01-01T14:00:02+14:00")], Span(end_ns=2 * S)),
        ([("from", "0001-01-01T00:00:00Z"), ("to", "9999-12-31T23:59:59-14:00")], Span(0, 2**63 - 1)),
    ],
)
def test_a_query_is_a_span(said: list[tuple[str, str]], span: Span) -> None:
    assert parse_span(said) == span


@pytest.mark.parametrize(
    "said",
    [
        *(
            [("last", text)]
            for text in ("", "x", "P", "PT", "P1DT", "1S", "PT1X", "PT-1S", "PT1S ", "PT٣S", "PT9999999S")
        ),
        *([("from", text)] for text in ("", "2026", "2026-11-22T00:00:00", "2026-13-22T00:00:00Z", "-1", "٢", "now")),
        *(
            [("from", text)]
            for text in ("2026-11-22T00:00:00+15:00", "2026-11-22T00:00:00-14:01", "2026-11-22T24:00:00.1Z")
        ),
        *([("last", text)] for text in ("P1YT", "P1D1Y", "P12345Y", "P1W")),
        *([("to", text)] for text in ("2026-11-22T00:00:00.0000000001Z", "2026-11-22T24:00:01Z", "x" * 5000)),
        *([("limit", text)] for text in ("0", "-1", "1.5", "٣", "1e3", "9" * 30, "")),
        *([("every", text)] for text in ("", "1", "PT-1S", "P", "P12D", "PT1000000S")),
        [("at", "2026-11-22T00:00:00Z"), ("every", "PT1S")],
        [("last", "PT1S"), ("last", "PT2S")],
        [("last", "PT1S"), ("to", "2026-11-22T00:00:00Z")],
        [("from", "2026-11-22T00:00:01Z"), ("to", "2026-11-22T00:00:00Z")],
        [("form", "2026-11-22T00:00:01Z")],
    ],
)
def test_an_invalid_span_is_refused_with_a_valid_example(said: list[tuple[str, str]]) -> None:
    with pytest.raises(BadRequest) as refused:
        parse_span(said)
    assert len(str(refused.value)) < 200


@given(st.integers(0, 2**63 - 1), st.integers(1, 999_999_999))
def test_a_written_time_is_parsed_to_the_same_time(stamp_ns: int, limit: int) -> None:
    assert parse_span(parse_qsl(query(from_=lexical_time(stamp_ns), limit=limit))) == Span(
        begin_ns=stamp_ns, limit=limit
    )


@pytest.mark.parametrize("last", ["P400Y", "P9999Y9999M999999D"])
def test_a_span_that_is_longer_than_all_times_begins_with_them(last: str) -> None:
    for newest_ns in (0, 5, 2**63 - 1):
        assert 0 <= (parse_span([("last", last)]).begin(newest_ns) or 0) <= newest_ns


def test_observations_are_bounded() -> None:
    assert parse_span([("limit", "999999999")]).observations == parse_span([("last", "P1D")]).observations == MOST
    assert parse_span([]).observations < 50
