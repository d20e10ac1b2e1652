"""The documentation of rules is true: its rules are accepted, and its numbers are those of the code."""

import re
from pathlib import Path

import pytest

from linked_fleet_gateway.extensions.query.sparql_syntax import check_select
from linked_fleet_gateway.extensions.rules import engine, request, service, store, template
from linked_fleet_gateway.extensions.rules.extension import RuleSettings
from linked_fleet_rdf.serialise import parse

_PAGE = (Path(__file__).parents[5] / "gateway/linked_fleet_gateway/extensions/rules/README.md").read_text()
_RULES = [text for text in re.findall(r"```turtle\n(.*?)```", _PAGE, re.S) if "a lf:Rule" in text]
_BASE = "http://localhost:8000"


@pytest.mark.parametrize("text", _RULES)
def test_its_rules_are_taken(text: str) -> None:
    container = _BASE + request.CONTAINER
    wanted = request.parse_rule(parse(text.encode(), "text/turtle", container), container, _BASE)
    request.check_variables(wanted, check_select(wanted.condition), _BASE)
    assert wanted.invokes.startswith(_BASE) and wanted.body


def test_a_rule_that_speaks_of_nothing_is_not() -> None:
    container = _BASE + request.CONTAINER
    wanted = request.parse_rule(parse(_RULES[0].encode(), "text/turtle", container), container, _BASE)
    with pytest.raises(request.UnprocessableContent, match=r"\?z"):
        request.check_variables(wanted, ["hand", "x", "y"], _BASE)


def test_its_numbers_are_those_of_the_code() -> None:
    most = RuleSettings().per_client
    said = (
        f"at most {template.MOST_TRIPLES} triples", f"a lease of {store.LEASE_S:g} s", f"the last {store.KEPT} firings",
        f"a fleet {store.MOST};", f"at most {most} (", f"together, {store.AT_ONCE} at most",
        f"up to {service.MEETING_S:g} s", f"| {request.INTERVAL_S:g} |",
    )  # fmt: skip
    assert [each for each in said if each not in " ".join(_PAGE.split())] == []
    assert (engine.EVERY_S, engine.SHARE) == (0.1, 4)  # "ten times a second", "a quarter of the time"
