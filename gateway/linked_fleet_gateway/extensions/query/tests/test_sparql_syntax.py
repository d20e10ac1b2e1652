"""Facts about a query without parsing it: form, dataset, variables, and unsupported features."""

import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from linked_fleet_base.errors import BadRequest, FleetError, PayloadTooLarge
from linked_fleet_gateway.extensions.query.sparql_syntax import Dataset, check_select, parse_query
from linked_fleet_rdf.sparql_tokens import MAX_DEPTH, MAX_QUERY_BYTES

BASE = "http://fleet.example/query"


@pytest.mark.parametrize(
    ("query", "form"),
    [
        ("SELECT * {}", "SELECT"),
        ("# SERVICE\nPREFIX : <http://a#> BASE <http://b/> ask {}", "ASK"),
        ("prefix SELECT: <http://a/> CONSTRUCT WHERE { ?s SELECT:x ?o }", "CONSTRUCT"),
        ("DESCRIBE <http://a/SERVICE>", "DESCRIBE"),
        (
            'PREFIX a:<b>SELECT * { ?service ?p \'SERVICE\', """SERVICE " {""", \'a\'@service ; a:SERVICE _:SERVICE }',
            "SELECT",
        ),
    ],
)
def test_a_query_is_known_by_its_first_keyword(query: str, form: str) -> None:
    assert parse_query(query, BASE).form == form


@pytest.mark.parametrize(
    "query",
    [
        "",
        "nothing",
        "INSERT DATA { <http://a> <http://b> 1 }",
        "PREFIX a: <http://a/> DELETE WHERE { ?s ?p ?o }",
        "LOAD <http://a>",
        "SELECT * { SERVICE <http://a/> { ?s ?p ?o } }",
        "SELECT * { service silent ?g { ?s ?p ?o } }",
        "SELECT * { ?s ?p 'it\\'s' . SeRvIcE<http://a/>{} }",
        "SELECT * { FILTER(?a<?b)SERVICE ?c {} }",
        "SELECT * FROM a:b {}",
        "SELECT * FROM 'b' {}",
        "SELECT * FROM <http://[> {}",
        "SELECT * {" + "(" * (MAX_DEPTH + 1),
        "SELECT \ud800 {}",
        "SELECT \0 {}",
    ],
)
def test_unsupported_queries_are_refused_with_a_reason(query: str) -> None:
    with pytest.raises(BadRequest, match=r"\w+"):
        parse_query(query, BASE)


def test_a_long_query_is_refused() -> None:
    with pytest.raises(PayloadTooLarge):
        parse_query("SELECT * {}" + " " * MAX_QUERY_BYTES, BASE)


def test_a_refusal_says_where() -> None:
    with pytest.raises(BadRequest) as refused:
        parse_query("SELECT *\n{ SERVICE ?s {} }", BASE)
    assert (refused.value.line, refused.value.column) == (2, 3)


@pytest.mark.parametrize(
    ("query", "default", "named"),
    [
        ("SELECT * {}", None, None),
        ("SELECT * FROM <a/> FROM <http://b/c> {}", ("http://fleet.example/a/", "http://b/c"), ()),
        ("BASE <http://x/y/> ASK FROM NAMED <z> {}", (), ("http://x/y/z",)),
        ("PREFIX r: <http://r/> CONSTRUCT { ?s ?p ?o } FROM r:one\\-2 FROM named r: WHERE { ?s ?p ?o }",
         ("http://r/one-2",), ("http://r/",)),
        ("SELECT * FROM <http://a/\\u0062> {}", ("http://a/b",), ()),
        ("SELECT ?from { ?from ?p 'FROM <http://a>' } # FROM <http://a>", None, None),
    ],
)  # fmt: skip
def test_the_dataset_is_the_one_that_the_query_says(
    query: str, default: tuple[str, ...] | None, named: tuple[str, ...] | None
) -> None:
    assert parse_query(query, BASE).dataset == Dataset(default, named)


@pytest.mark.parametrize(
    ("query", "variables"),
    [
        ("SELECT ?a $b {}", ["a", "b"]),
        ("PREFIX p: <http://p/> SELECT DISTINCT ?a WHERE { ?a p:b ?c { SELECT ?d {} } }", ["a"]),
        ("SELECT (COUNT(?x) AS ?n) (IF(?y, 'AS ?z', (?w)) as ?m) ?v FROM <http://a> {}", ["n", "m", "v"]),
    ],
)
def test_the_variables_of_a_query_are_those_that_it_selects(query: str, variables: list[str]) -> None:
    assert check_select(query) == variables


@pytest.mark.parametrize(
    "query", ["ASK {}", "SELECT * {}", "SELECT ?a ?a {}", "SELECT {}", "SELECT ?a { SERVICE ?b {} }"]
)
def test_a_query_that_selects_nothing_by_name_is_refused(query: str) -> None:
    with pytest.raises(BadRequest):
        check_select(query)


_WORDS = "SELECT FROM NAMED SERVICE PREFIX BASE AS ASK ?x { } ( ) < > <http://a> a:b ' \" ''' \\ \\u0041 # @en 1.0 *"
_PIECES = st.sampled_from([*_WORDS.split(), "\n"])


@given(st.lists(_PIECES | st.text(max_size=3), max_size=40).map(" ".join))
def test_any_text_is_read_or_refused(text: str) -> None:
    for look in (lambda: parse_query(text, BASE), lambda: check_select(text)):
        try:
            look()
        except FleetError as error:
            assert error.status in (400, 413)


@pytest.mark.parametrize(
    ("query", "missing", "column"),
    [
        ("SELECT * { ?s foo:bar ?o }", "PREFIX foo: <…>", 15),
        ("SELECT * { ?s ?p ?o FILTER(foo:bar(?o)) }", "PREFIX foo: <…>", 28),
        ("SELECT * { ?s lf:title ?o }", "PREFIX lf: <https://w3id.org/linked-fleet#>", 15),
        ("PREFIX foo: <x> ASK { ?s :bar ?o }", "PREFIX : <…>", 26),
    ],
)
def test_an_undeclared_prefix_is_named(query: str, missing: str, column: int) -> None:
    with pytest.raises(BadRequest, match=re.escape(missing)) as refusal:
        parse_query(query, BASE)
    assert refusal.value.members == {"line": 1, "column": column}


@pytest.mark.parametrize(
    "query",
    [
        "PREFIX foo: <x> ASK { _:b foo:bar ?o }",
        "PREFIX : <x> ASK { :a :b 'foo:bar' # foo:bar\n}",
        "ASK { <foo:a> a ?b }",
    ],
)
def test_declared_prefixes_and_what_is_none_are_taken(query: str) -> None:
    assert parse_query(query, BASE).form == "ASK"
