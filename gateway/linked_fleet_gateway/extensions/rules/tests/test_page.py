"""The pages of rules, generated from triples as the gateway describes them."""

import pytest
from pyoxigraph import NamedNode

from linked_fleet_gateway.extensions.pages.values import Facts, State
from linked_fleet_gateway.extensions.query.sparql_syntax import check_select
from linked_fleet_gateway.extensions.rules import page
from linked_fleet_gateway.extensions.rules.page import EXAMPLES, Example
from linked_fleet_gateway.extensions.rules.request import parse_rule
from linked_fleet_rdf.serialise import parse

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


RULE = """<rules/1> a lf:Rule ; dcterms:title "one" ; lf:condition "SELECT ?x {}" ; lf:invokes [ lf:variable "task" ] ;
    lf:body [ lf:poseName "up" ; lf:position [ lf:speed [ lf:variable "x" ] ] ] ;
    lf:toldApartBy "x", "y" ; lf:minimumInterval 2.5 ; lf:enabled false ; lf:state lf:disabled ."""


def test_the_form_of_a_saved_rule_says_what_the_rule_says() -> None:
    """Condition, action with body, and options can be changed; sent as it is, the form changes nothing."""
    iri = NamedNode(ROOT + "rules/1")
    form = page.rule(facts(RULE), iri).more["form"]
    fields = {each.path.rpartition("#")[2].rpartition("/")[2]: each for each in (*form.needed, *form.further)}
    assert [each.path.rpartition("#")[2] for each in form.needed][1:] == ["condition", "invokes", "body"]
    assert (form.action, form.methods) == (iri.value, "PUT")
    assert (fields["title"].value, fields["condition"].value, fields["condition"].editor) == (
        "one",
        "SELECT ?x {}",
        "sparql",
    )
    assert (fields["invokes"].value, fields["invokes"].term_kind) == ("?task", "variable")
    assert [each.value for each in fields["toldApartBy"].repeated] == ["x", "y"]
    assert (fields["minimumInterval"].value, fields["enabled"].value) == ("2.5", "false")
    sent = "".join(
        (
            '<> a lf:Rule ; dcterms:title "one" ; lf:condition "SELECT ?x {}" ; lf:invokes [ lf:variable "task" ] ; ',
            'lf:toldApartBy "x", "y" ; lf:minimumInterval 2.5 ; lf:enabled false ; lf:body _:body .\n',
            fields["body"].value,
        )
    )
    triples = parse((PREFIXES + sent).encode(), "text/turtle", iri.value)
    before = parse((PREFIXES + RULE).encode(), "text/turtle", RULES.value)
    base = ROOT.rstrip("/")
    assert fields["body"].term_kind == "turtle"
    assert parse_rule(triples, iri.value, base) == parse_rule(before, iri.value, base)


def test_the_form_of_a_new_rule_begins_with_an_example() -> None:
    form = page.rules(facts("<rules> a lf:RuleList ."), RULES).more["form"]
    assert (form.action, form.methods) == (RULES.value, "POST")
    values = {each.path.rpartition("#")[2]: each.value for each in form.needed}
    assert (values["condition"], values["invokes"]) == (EXAMPLES[0].condition, EXAMPLES[0].invokes)
    assert values["body"] == EXAMPLES[0].body
