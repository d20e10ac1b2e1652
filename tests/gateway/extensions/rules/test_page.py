"""The pages of rules, generated from triples as the gateway describes them."""

import pytest
from pyoxigraph import NamedNode

from linked_fleet_gateway.extensions.pages.values import Facts, State
from linked_fleet_gateway.extensions.rules import page
from linked_fleet_gateway.extensions.rules.examples import EXAMPLES, Example
from linked_fleet_gateway.rdf.serialise import parse
from linked_fleet_gateway.rdf.sparql_syntax import check_select

ROOT = "http://fleet.example/"
RULES = NamedNode(ROOT + "rules")
PREFIXES = """@prefix lf: <https://w3id.org/linked-fleet#> . @prefix ldp: <http://www.w3.org/ns/ldp#> .
@prefix dcterms: <http://purl.org/dc/terms/> . @prefix xsd: <http://www.w3.org/2001/XMLSchema#> .
"""
FIRING = """a lf:Firing ; lf:state lf:failed ; lf:reason "held by somebody else" ;
    dcterms:created "2026-01-01T00:00:00Z"^^xsd:dateTime """


def facts(text: str) -> Facts:
    return Facts(parse((PREFIXES + text).encode(), "text/turtle", RULES.value), ROOT)


def test_a_rule_is_listed_with_its_state_and_last_firing() -> None:
    said = facts(f"""<rules> ldp:contains <rules/1>, <rules/2> .
        <rules/1> a lf:Rule ; dcterms:title "one" ; lf:state lf:active ; lf:enabled true ;
            lf:lastFiring <rules/1/firings/7> .
        <rules/1/firings/7> {FIRING} ; lf:invocation <ur5/actions/stop/invocations/x> .
        <rules/2> a lf:Rule ; dcterms:title "two" ; lf:state lf:disabled ; lf:enabled false ; lf:reason "stopped" .""")
    part = page.rules(said, RULES)
    one, two = part.more["listed"]
    assert (one.link.text, one.enabled, one.state.name, one.reasons) == ("one", True, "active", [])
    assert isinstance(one.last.state, State) and one.last.state.name == "failed"
    assert (one.last.reason, one.last.did.href) == ("held by somebody else", ROOT + "ur5/actions/stop/invocations/x")
    assert (two.enabled, two.reasons, two.last) == (False, ["stopped"], None)
    assert {each.value for each in part.done if isinstance(each, NamedNode)} == {  # displayed, so not listed again
        f"{ROOT}rules/1", f"{ROOT}rules/2", f"{ROOT}rules/1/firings/7",
    }  # fmt: skip


def test_a_firing_says_why_it_fired() -> None:
    said = facts(f"""<rules> ldp:contains <rules/1> .
        <rules/1> {FIRING} ; lf:binding [ lf:variable "x" ; lf:value 0.123456 ],
            [ lf:variable "r" ; lf:value <ur5/> ] .""")
    (fired,) = page.firings(said, RULES).more["fired"]
    assert fired.did is None
    assert {name: value.text for name, value in fired.bindings} == {"x": "0.1235", "r": "ur5"}


@pytest.mark.parametrize("example", EXAMPLES, ids=lambda each: each.invokes)
def test_examples_are_rules_whose_body_is_turtle(example: Example) -> None:
    selected = check_select(example.condition)
    assert set(example.told_apart_by.split()) <= set(selected)
    triples = parse(example.body.encode(), "text/turtle", RULES.value)
    assert bool(triples) == (not example.invokes.endswith("/stop"))
