"""Plain JSON bodies without a counterpart in a form."""

import json

import pytest
from pyoxigraph import BlankNode, Literal, NamedNode, RdfFormat, Triple, parse

from linked_fleet_base.errors import BadRequest, PayloadTooLarge
from linked_fleet_gateway.resources.json_form import form_in, form_of
from linked_fleet_gateway.resources.plain_json import _JsonWriter, parse_json_body, stored_json
from linked_fleet_rdf.vocabulary import LF, XSD

IRI = "http://127.0.0.1:8000/arm/title"


@pytest.mark.parametrize(
    ("body", "message"),
    [
        (b'{"value": "\\ud800"}', r"\\ud800 is half of a surrogate pair"),
        (b'{"\\udc00": "x"}', r"\\udc00 is half of a surrogate pair"),
        (b'{"value": "x", "value": "y"}', "two members of the same name"),
        (b"[" * 40 + b"]" * 40, "nested more than 16"),
        (b'{"value": [' + b"1," * 400 + b"1]}", "more than 400 commas and opening brackets"),
        (b'{"value": NaN}', "NaN is not JSON"),
        (b'{"value": "\xff"}', "not UTF-8"),
    ],
)  # fmt: skip
def test_json_that_no_text_or_tree_can_hold_is_malformed(body: bytes, message: str) -> None:
    """Each gets 400 with the reason; nothing of it reaches a log or a response that must be encoded."""
    with pytest.raises(BadRequest, match=message) as caught:
        parse_json_body(body, form_of(LF.TextInput), IRI, 100)
    caught.value.detail.encode()


def test_json_of_too_many_triples_is_too_large() -> None:
    """413, as for RDF: no schema limits the total number."""
    with pytest.raises(PayloadTooLarge, match="more than 1 things"):
        parse_json_body(b'{"holder": "x", "duration": 60}', form_of(LF.ControlLeaseInput), IRI, 1)


def _shape(constraint: str) -> str:
    """Return a shape of one member, ``value``."""
    return (
        "@prefix sh: <http://www.w3.org/ns/shacl#> . @prefix xsd: <http://www.w3.org/2001/XMLSchema#> . "
        f"<urn:shape> sh:property [ sh:path <urn:value> ; sh:name 'value' ; sh:maxCount 1 ; {constraint} ] ."
    )


@pytest.mark.parametrize(
    ("constraint", "lexical", "datatype", "shown"),
    [
        ("sh:datatype xsd:dateTime", "2030-01-01T00:00:00Z", XSD.dateTime, "2030-01-01T00:00:00Z"),
        ("sh:datatype xsd:date", "2030-01-01", XSD.date, "2030-01-01"),
        ("sh:datatype xsd:time", "12:00:00", XSD.time, "12:00:00"),
        ("sh:datatype xsd:duration", "P1D", XSD.duration, "P1D"),
        ("sh:datatype xsd:anyURI", "https://example.org/", XSD.anyURI, "https://example.org/"),
        ("sh:datatype xsd:string", "P1D", XSD.string, "P1D"),
        ("sh:or ( [ sh:datatype xsd:string ] [ sh:datatype xsd:date ] )", "2030", XSD.string, "2030"),
        ("sh:datatype xsd:boolean", "1", XSD.boolean, True),
        ("sh:datatype xsd:boolean", "false", XSD.boolean, False),
        ("sh:datatype xsd:integer", "3", XSD.integer, 3),
        ("sh:datatype xsd:nonNegativeInteger", "3", XSD.nonNegativeInteger, 3),
        ("sh:datatype xsd:decimal", "3", XSD.decimal, 3.0),
        ("sh:datatype xsd:decimal", "0.0000001", XSD.decimal, 1e-07),
        ("sh:datatype xsd:float", "3", XSD.float, 3.0),
        ("sh:datatype xsd:double", "0.5", XSD.double, 0.5),
        ("sh:or ( [ sh:datatype xsd:decimal ] [ sh:datatype xsd:integer ] )", "3", XSD.integer, 3.0),
    ],
)
def test_what_is_read_in_json_may_be_written_back(
    constraint: str, lexical: str, datatype: NamedNode, shown: object
) -> None:
    """A JSON value becomes a literal of the datatype that the shape wants."""
    form = form_in([each.triple for each in parse(_shape(constraint), format=RdfFormat.TURTLE)], NamedNode("urn:shape"))
    there = Triple(NamedNode("urn:x"), NamedNode("urn:value"), Literal(lexical, datatype=datatype))
    document = _JsonWriter([there]).object(form, NamedNode("urn:x"))
    assert document == {"value": shown} and type(document["value"]) is type(shown)
    (back,) = parse_json_body(json.dumps(document).encode(), form, IRI, 10)
    assert isinstance(back.object, Literal)
    assert back.object.datatype in ({datatype, XSD.decimal} if "sh:or" in constraint else {datatype})
    if isinstance(shown, str):
        assert back.object.value == lexical
    else:
        assert json.loads(back.object.value) == shown


def test_what_an_operation_has_produced_is_named_by_its_predicates() -> None:
    """Several values are an array, blank nodes objects, and names that are taken already whole IRIs."""
    stored = """
        _:output <urn:my#booking> "b1" .
        _:output <urn:my#place> <http://127.0.0.1/zones/1> .
        _:output <urn:my#count> "2"^^<http://www.w3.org/2001/XMLSchema#integer> .
        _:output <urn:my#at> _:b .
        _:b <urn:my#x> "0.5"^^<http://www.w3.org/2001/XMLSchema#double> .
        _:output <urn:my#tag> "a" .
        _:output <urn:my#tag> "b" .
        _:output <urn:other#tag> "c" .
    """
    told = stored_json(stored, BlankNode("output"))
    tags = told.pop("tag"), told.pop("urn:other#tag")
    assert tags == (["a", "b"], "c")
    assert told == {"booking": "b1", "place": "http://127.0.0.1/zones/1", "count": 2, "at": {"x": 0.5}}


def test_a_circle_of_blank_nodes_ends() -> None:
    stored = "_:output <urn:my#next> _:output .\n"
    assert str(stored_json(stored, BlankNode("output"))).count("next") < 20
