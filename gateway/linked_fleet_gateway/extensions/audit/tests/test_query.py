"""A request selects entries of the audit."""

from urllib.parse import parse_qsl

import pytest

from linked_fleet_gateway.api import BadRequest
from linked_fleet_gateway.extensions.audit.query import Query, parse_query


def parsed(**said: str) -> Query:
    return parse_query([(name.rstrip("_"), value) for name, value in said.items()])


def test_a_query_is_written_as_it_was_read() -> None:
    said = {
        "who": "ada@plant", "robot": "ur5", "resource": "/ur5/", "action": "rotate", "text": "a b",
        "from_": "2026-11-30T10:00:00Z", "until": "2026-11-30T10:00:00.5Z", "pages": "on", "before": "1-2p",
        "limit": "7", "outcome": "refused",
    }  # fmt: skip
    query = parsed(**said)
    assert parse_query(parse_qsl(query.at("1-2p"))) == query
    assert query.filters.keys() == {name.rstrip("_") for name in said} - {"before", "limit"}


def test_empty_fields_of_the_form_select_everything() -> None:
    assert parsed(who="", outcome="", from_="", until=" ", as_="json") == Query()


def test_a_time_of_a_browser_is_in_utc() -> None:
    assert parsed(from_="2026-11-30T10:00").from_ns == parsed(from_="2026-11-30T11:00:00+01:00").from_ns


@pytest.mark.parametrize(
    ("said", "sentence"),
    [
        ({"whom": "ada"}, "The parameters of the audit are who, robot"),
        ({"resource": "ur5"}, "resource is a path"),
        ({"outcome": "good"}, "outcome is one of succeeded, refused, failed, ended"),
        ({"pages": "yes"}, "pages is one of on, off"),
        ({"before": "x"}, "before is the id"),
        ({"before": "0-0"}, "before is the id"),
        ({"before": "9" * 20 + "-0"}, "before is the id"),
        ({"after": "1-2-3"}, "after is the id"),
        ({"limit": "0"}, "limit is a whole number"),
        ({"limit": "1001"}, "limit is a whole number"),
        ({"limit": "٣"}, "limit is a whole number"),
        ({"from_": "yesterday"}, "from is a time"),
        ({"from_": "2026-11-30T10:00", "until": "2026-11-30T10:00"}, "until is later than from"),
        ({"text": "x" * 201}, "text has at most 200 characters"),
    ],
)
def test_what_cannot_be_meant_is_refused(said: dict[str, str], sentence: str) -> None:
    with pytest.raises(BadRequest, match=sentence):
        parsed(**said)
