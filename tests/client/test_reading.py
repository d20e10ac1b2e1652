"""Values in descriptions: items of lists, and what is nested in them."""

from rdflib import Graph, URIRef

from linked_fleet_client.quantity import Quantity
from linked_fleet_client.reading import read

_PREFIXES = """@prefix : <http://127.0.0.1/v#> . @prefix vom: <http://vocab.arvida.de/2015/06/vom/vocab#> .
@prefix unit: <http://qudt.org/vocab/unit/> . @prefix rdf: <http://www.w3.org/1999/02/22-rdf-syntax-ns#> .
"""
IT = URIRef("http://127.0.0.1/it")


def values(turtle: str) -> dict[str, object]:
    graph = Graph().parse(data=_PREFIXES + turtle, format="turtle", publicID=str(IT))
    found = read(graph, IT).values
    return {name: each.number if isinstance(each, Quantity) else each for name, each in found.items()}


def test_items_of_a_list_have_their_numbers() -> None:
    assert values("<> :sequence (0 1 1 2) ; :names (\"a\" \"b\") .") == {
        "sequence[0]": 0, "sequence[1]": 1, "sequence[2]": 1, "sequence[3]": 2, "names[0]": "a", "names[1]": "b",
    }  # fmt: skip


def test_items_may_be_quantities_nodes_and_lists() -> None:
    turtle = "<> :path ( [ vom:numericalValue 1.5 ; vom:unit unit:M ] [ :x 2 ; :y 3 ] (4 5) ) ."
    assert values(turtle) == {"path[0]": 1.5, "path[1].x": 2, "path[1].y": 3, "path[2][0]": 4, "path[2][1]": 5}


def test_an_empty_list_has_no_items() -> None:
    assert values("<> :path () ; :x 1 .") == {"x": 1}


def test_a_list_that_leads_back_to_itself_or_into_itself_ends() -> None:
    assert len(values("<> :path _:a . _:a rdf:first 1 ; rdf:rest _:a .")) == 20_000
    assert values("<> :path _:a . _:a rdf:first _:a ; rdf:rest () .") == {}
