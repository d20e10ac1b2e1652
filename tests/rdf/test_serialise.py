"""Written documents are parsed back as the same graph; foreign documents are parsed within limits, or refused."""

import json
import xml.etree.ElementTree as ET
from collections.abc import Iterable
from io import BytesIO
from typing import Any

import pytest
import rdflib
from hypothesis import given, settings
from hypothesis import strategies as st
from pyjelly.integrations.generic.parse import parse_jelly_flat
from pyoxigraph import BlankNode, CanonicalizationAlgorithm, Dataset, Literal, NamedNode, Quad, Triple
from rdflib.compare import isomorphic

from linked_fleet_rdf import parsing
from linked_fleet_rdf.serialise import JELLY, RDF_TYPES, ParseError, parse, render
from properties import examples

BASE = "http://127.0.0.1:8000/baxter/right_s1"
RDF = "http://www.w3.org/1999/02/22-rdf-syntax-ns#"
XSD = "http://www.w3.org/2001/XMLSchema#"
ROS = "http://ros.org/#"
PREFIXES = {
    "ros": ROS,
    "xsd": XSD,
    "unit": "http://qudt.org/vocab/unit/",
    "rdf": RDF,
    "here": "http://127.0.0.1:8000/x/",
}


def is_iri(text: str) -> bool:
    try:
        return NamedNode(text).value == text
    except ValueError:
        return False


LOCALS = st.sampled_from(
    ["", "a", "a.b", "a.", "-a", "1a", "a/b", "a:b", "é", "a%20b", "a?b", "a#b", "a(b)", ".", "..", "_"]
)
BASES = st.sampled_from(
    [BASE, "http://h", "http://h/", "http://h/a/b/", "http://h/a/../b", "http://h/a?q#f", "", "urn:x"]
)
FAR = st.sampled_from(
    [*PREFIXES.values(), "urn:", "unit:", "http://h", "http://h/", "http://h/a/", "http://h/a//", BASE, BASE + "#"]
)
IRIS = st.builds(str.__add__, FAR, LOCALS).filter(is_iri).map(NamedNode)
PREDICATES = st.sampled_from(
    [ROS + "p", ROS + "q", RDF + "type", RDF + "first", RDF + "rest", "urn:x:p", "http://h/a/b"]
)
NODES = st.integers(0, 5).map(lambda number: BlankNode(f"n{number}"))
TEXT = st.text(st.characters(codec="utf-8"), max_size=8)
XML_TEXT = st.text(
    st.characters(codec="utf-8", exclude_categories=["Cc", "Cs", "Cn"]) | st.sampled_from("\t\n\r<&>\"'")
)
NUMBERS = st.sampled_from(
    [
        "1",
        "-1",
        "+1",
        "01",
        "1.",
        ".5",
        "-0",
        "-0.0",
        "1.5",
        "1e3",
        "1.5E0",
        "1.0E-1",
        "1.0E22",
        "NaN",
        "INF",
        "true",
        "1.5E-10",
        "1.05E1",
        "x",
    ]
)
TYPED = st.builds(
    lambda text, name: Literal(text, datatype=NamedNode(XSD + name)),
    NUMBERS | st.floats().map(repr) | st.integers().map(str),
    st.sampled_from(["integer", "decimal", "double", "float", "boolean", "string"]),
)
LITERALS = TEXT.map(Literal) | st.builds(lambda text: Literal(text, language="de-DE"), TEXT) | TYPED
TRIPLES = st.builds(Triple, IRIS | NODES, PREDICATES.map(NamedNode), IRIS | NODES | LITERALS)
GRAPHS = st.lists(TRIPLES, max_size=14)


def canonical(triples: list[Triple]) -> set[Quad]:
    dataset = Dataset(Quad(*triple) for triple in triples)
    dataset.canonicalize(CanonicalizationAlgorithm.UNSTABLE)
    return set(dataset)


def turtle(text: str) -> list[Triple]:
    return parse(text.encode(), "text/turtle", BASE)


@pytest.mark.parametrize("media_type", ["text/turtle", "application/ld+json", "application/n-triples"])
@settings(max_examples=examples(400))
@given(GRAPHS, BASES)
def test_round_trip(media_type: str, triples: list[Triple], base: str) -> None:
    """Every graph, cyclic or odd, survives writing and parsing, whatever the base."""
    body = render(triples, media_type, PREFIXES, base=base)
    back = parse(body, media_type, "http://elsewhere/", max_depth=1000)
    assert canonical(back) == canonical(triples), body.decode()


@settings(max_examples=examples(200))
@given(GRAPHS, XML_TEXT)
def test_round_trip_rdf_xml(triples: list[Triple], text: str) -> None:
    """RDF/XML keeps all that XML can hold, and is well-formed to other parsers."""
    kept = [t for t in triples if not (isinstance(t.object, Literal) and not t.object.value.isprintable())]
    kept = [t for t in kept if t.predicate.value != RDF + "type"]
    kept.append(Triple(NamedNode(BASE), NamedNode(ROS + "text"), Literal(text)))
    body = render(kept, "application/rdf+xml", PREFIXES, base=BASE)
    ET.fromstring(body)
    assert canonical(parse(body, "application/rdf+xml", BASE, max_depth=1000)) == canonical(kept)


@settings(max_examples=examples(200))
@given(GRAPHS)
def test_round_trip_jelly(triples: list[Triple]) -> None:
    """Every graph survives writing in Jelly and parsing by another library."""
    body = render(triples, JELLY, PREFIXES, base=BASE)
    assert canonical(list(map(plain, parse_jelly_flat(BytesIO(body))))) == canonical(triples)


def plain(statement: Iterable[Any]) -> Triple:
    def term(said: Any) -> NamedNode | BlankNode | Literal:
        match type(said).__name__:
            case "IRI":
                return NamedNode(said._iri)
            case "BlankNode":
                return BlankNode(said._identifier)
        return Literal(
            said._lex, language=said._langtag, datatype=NamedNode(said._datatype) if said._datatype else None
        )

    return Triple(*map(term, statement))


def test_rdflib_reads_jelly() -> None:
    """A document of several frames is the same graph to rdflib in Jelly and in N-Triples."""
    numbers = "".join(f'<{number}> ros:p {number}, "{number}"@en, [ ros:q <x#{number}> ] . ' for number in range(99))
    triples = turtle(f"@prefix ros: <{ROS}> . {numbers}")
    read = [
        rdflib.Graph().parse(data=render(triples, media_type, PREFIXES, base=BASE), format=name)
        for name, media_type in (("jelly", JELLY), ("nt", "application/n-triples"))
    ]
    assert len(read[0]) == 396
    assert isomorphic(*read)


def test_rdf_xml_refuses_what_has_no_xml_name() -> None:
    """RDF/XML cannot write a predicate whose IRI does not end in a name; an error is better than a wrong document."""
    with pytest.raises(ValueError, match="cannot name http://h/1"):
        render([Triple(NamedNode(BASE), NamedNode("http://h/1"), Literal("x"))], RDF_TYPES[3], PREFIXES, base=BASE)


def test_rdf_xml_replaces_what_xml_cannot_hold() -> None:
    """A control character becomes U+FFFD instead of breaking the document."""
    body = render(
        [Triple(NamedNode(BASE), NamedNode(ROS + "p"), Literal("a\x01b"))], "application/rdf+xml", PREFIXES, base=BASE
    )
    assert "a\ufffdb" in body.decode() and ET.fromstring(body) is not None


@pytest.mark.parametrize("media_type", RDF_TYPES)
def test_same_triples_same_bytes(media_type: str) -> None:
    """Labels invented by parsers never show, so that an ETag can be the hash of the body."""
    text = "<> <urn:p> [ <urn:q> _:x, ( 1 [] ) ] . _:x <urn:r> _:x . [] <urn:s> _:x ."
    assert render(turtle(text), media_type, PREFIXES, base=BASE) == render(
        turtle(text), media_type, PREFIXES, base=BASE
    )


def test_turtle_reads_as_written_by_hand() -> None:
    """Types first, nested nodes indented, lists in brackets, bare numbers, only the used prefixes."""
    triples = turtle(
        f'@prefix ros: <{ROS}> . <> ros:p 1.5, "x"^^<{XSD}float> ; a ros:Joint ; ros:q [ a ros:Limit ; ros:r ( 1 2 ) ],'
        " <right_s1/rotation>, <./> ."
    )
    assert render(triples, "text/turtle", PREFIXES, base=BASE).decode() == (
        f"@base <{BASE}> .\n@prefix ros: <{ROS}> .\n@prefix xsd: <{XSD}> .\n\n"
        '<> a ros:Joint ;\n    ros:p 1.5, "x"^^xsd:float ;\n    ros:q [\n        a ros:Limit ;\n'
        "        ros:r ( 1 2 )\n    ], <right_s1/rotation>, <./> .\n"
    )


def test_json_ld_is_compact_and_nested() -> None:
    """One subject is one node object, numbers are native if they mean the same literal."""
    triples = turtle(f"@prefix ros: <{ROS}> . <> a ros:Joint ; ros:p 1, 1.5, 1.5E0, true ; ros:q [ ros:r ( 1 2 ) ] .")
    assert json.loads(render(triples, "application/ld+json", PREFIXES, base=BASE)) == {
        "@context": {"ros": ROS, "xsd": XSD},
        "@id": BASE,
        "@type": "ros:Joint",
        "ros:p": [1, {"@value": "1.5", "@type": "xsd:decimal"}, 1.5, True],
        "ros:q": {"ros:r": {"@list": [1, 2]}},
    }


def test_writers_never_recurse_deep() -> None:
    """Chains, lists and broken lists of any length survive writing and parsing."""
    for predicate in (ROS + "p", RDF + "rest"):
        chain = [Triple(BlankNode(f"c{i}"), NamedNode(predicate), BlankNode(f"c{i + 1}")) for i in range(3000)]
        for media_type in ("text/turtle", "application/ld+json"):
            body = render(chain, media_type, PREFIXES, base=BASE)
            assert len(parse(body, media_type, BASE, max_triples=5000, max_depth=5000)) == 3000


def test_unknown_media_type_is_a_programming_error() -> None:
    """Negotiation comes first; skipping it is reported."""
    with pytest.raises(ValueError, match="no writer for text/plain"):
        render([], "text/plain", PREFIXES, base=BASE)


SNIPPETS = st.lists(
    st.sampled_from(
        [
            '{"@context":',
            '{"@id":',
            "[",
            "]",
            "{",
            "}",
            '"x"',
            ":",
            ",",
            "<",
            ">",
            "<a>",
            " .",
            ";",
            "( ",
            ")",
            "@prefix a: <b>",
            "_:b",
            '"',
            "\\",
            "'''",
            "<rdf:RDF",
            "<!ENTITY",
            "&a;",
            "<?xml?>",
            "1e999",
            "NaN",
            "\n",
            '"@graph"',
            '"@list"',
            "http://[",
        ]
    ),
    max_size=25,
).map(lambda parts: "".join(parts).encode())


@pytest.mark.parametrize("media_type", RDF_TYPES)
@settings(max_examples=examples(400))
@given(st.binary(max_size=60) | SNIPPETS)
def test_garbage_is_only_ever_a_parse_error(media_type: str, body: bytes) -> None:
    """Whatever the bytes, the parser returns triples or raises ParseError."""
    try:
        parse(body, media_type, BASE)
    except ParseError as error:
        assert error.message


@pytest.mark.parametrize(
    ("media_type", "body", "message"),
    [
        ("text/turtle", b"<a> <b> <c>, <d>, <e> .", "more than 2 triples"),
        ("text/turtle", b"<a> <b> [ <c> [ <d> [] ] ] .".replace(b"[]", b"[" + b"]"), "more than 2 triples|nested"),
        ("text/turtle", b'<a> <b> "' + b"x" * 5000 + b'" .', "5000 characters, at most 4096"),
        ("text/turtle", b"<a> <b> \xff .", "not UTF-8"),
        ("text/turtle", "<a> <b> <c\u00a0> .".encode(), "white space"),
        ("application/ld+json", '{"urn:p\u2003": "x"}'.encode(), "white space"),
        ("text/turtle", '<a> <b> "c"^^<d\u00a0> .'.encode(), "white space"),
        ("text/turtle", b"<a> <b> <<( <a> <b> <c> )>> .", "triple terms"),
        ("application/ld+json", b'{"@context": "http://evil.example/"}', "never fetched"),
        ("application/ld+json", b'{"@context": {"@import": "http://evil.example/"}}', "@import names a remote context"),
        ("application/ld+json", b'{"@cont\\u0065xt": "http://evil.example/"}', "never fetched"),
        ("application/ld+json", b'{"@id": "urn:g", "@graph": [{"@id": "urn:s", "urn:p": 1}]}', "Named graphs"),
        ("application/ld+json", b"[" * 100000, "more than 16 commas and opening brackets"),
        ("application/ld+json", b'{"urn:p":' * 100000, "more than 16 commas and opening brackets"),
        ("application/rdf+xml", b'<!DOCTYPE r [<!ENTITY a "aaa">]><r>&a;</r>', "entity"),
        ("text/turtle", b"@base <a/> .\n" * 300, "more than 256 base IRIs"),
        ("text/turtle", b"BASE#\n<a/>\n" * 300, "more than 256 base IRIs"),
        ("application/rdf+xml", b"<r " + b"".join(b'xmlns:a%d="u:"' % n for n in range(300)) + b"/>", "256 namespaces"),
        ("text/html", b"", "no parser for text/html"),
    ],
)  # fmt: skip
def test_bounds(media_type: str, body: bytes, message: str) -> None:
    """Size, depth, encoding, remote contexts, entities and named graphs are refused with the reason."""
    with pytest.raises(ParseError, match=message):
        parse(body, media_type, BASE, max_triples=2)


def test_depth_counts_nesting_but_not_the_length_of_lists() -> None:
    """33 nested nodes are too deep, a list of 200 numbers is not."""
    assert len(turtle(f"<> <urn:p> ( {'1 ' * 200}) .")) == 401
    assert len(turtle("<> <urn:p> " + "[ <urn:p> " * 32 + "1" + "]" * 32 + ".")) == 33
    with pytest.raises(ParseError, match="nested more than 32"):
        turtle("<> <urn:p> " + "[ <urn:p> " * 33 + "1" + "]" * 33 + ".")
    with pytest.raises(ParseError, match="nested more than 32"):
        turtle(" ".join(f"_:n{i} <urn:p> _:n{(i + 1) % 40} ." for i in range(40)))


def test_errors_say_where() -> None:
    """Line and column count from 1."""
    with pytest.raises(ParseError) as caught:
        turtle("<a> <b> <c> .\n<d> oops")
    assert caught.value.line == 2 and caught.value.column is not None


_OWN = {"@context": {"p": "urn:p"}}
_KNOWN = {"https://w3id.org/linked-fleet/context": _OWN, "http://127.0.0.1:8000/context": _OWN}


def _parse_json(document: object) -> list[Triple]:
    content = document if isinstance(document, bytes) else json.dumps(document).encode()
    return parse(content, "application/ld+json", BASE, contexts=_KNOWN)


@pytest.mark.parametrize(
    "context",
    [
        "https://w3id.org/linked-fleet/context",
        "/context",
        ["/context"],
        ["/context", {"q": "urn:q"}],
        {"p": "urn:p"},
        [{"p": {"@id": "urn:p", "@container": ["@set"]}}],
    ],
)
def test_one_context_at_the_top_is_taken(context: object) -> None:
    """Accepted are the project's own by absolute or relative IRI, an inline one, and one of each."""
    for document in ({"@context": context, "p": 1}, [{"@context": context, "p": 1}]):
        assert [triple.predicate for triple in _parse_json(document)] == [NamedNode("urn:p")]


def _scoped(uses: int, contexts: int) -> dict[str, object]:
    """Return a body of a few kilobytes that occupies a JSON-LD parser for ten seconds."""
    context = {"a": {"@id": "http://a/", "@context": ["/context"] * contexts}}
    return {"@context": context, "x": [{"a": {"a": 1}}] * uses}


@pytest.mark.parametrize(
    ("document", "message"),
    [
        (_scoped(300, 200), "scoped @context .a. is not accepted; accepted is one @context at the top"),
        ({"@context": {"a": {"@id": "urn:a", "@context": None}}}, "scoped"),
        ({"@context": {"c": "@context"}, "c": {}}, "scoped"),
        ({"@context": {"c": {"@id": "@context"}}}, "scoped"),
        ({"urn:x": {"@context": "/context"}}, "nested"),
        ({"urn:x": [[{"@context": {}}]]}, "nested"),
        ({"urn:x": {"@type": "@json", "@value": {"@context": {}}}}, "nested"),
        ([{"@context": "/context"}, {"@context": "/context"}], "nested"),
        ({"@context": ["/context", "/context"]}, "repeated"),
        ({"@context": [{}, {}]}, "repeated"),
        ({"@context": [["/context"]]}, "repeated"),
        ({"@context": [None]}, "repeated"),
        ({"@context": {"@propagate": False}}, "@propagate"),
        ({"@context": {"a": {"@id": {"b": 1}}}}, "no text"),
        ({"@context": {"a": {"id": "urn:a"}}}, "definition of a term"),
        ({"@context": {f"a{number}": "urn:a" for number in range(101)}}, "101 terms"),
        ({"@context": {"a": "urn:" + "a" * 300}}, "more than 256 characters"),
        ({"@context": {f"a{number}": "urn:" + "a" * 200 for number in range(90)}}, "8192"),
        (b'{"@context": "/context", "@context": {"a": {"@context": {}}}}', "two members of the same name"),
        (b'{"@context": "/context", "\\u0040context": {}}', "two members of the same name"),
        (b"[" * 500 + b"]" * 500, "nested more than 32"),
        (b'{"urn:p": ' * 40 + b"1" + b"}" * 40, "nested more than 32"),
        (b'{"urn:p": ' * 4000, "nested more than 32"),
    ],
    ids=lambda value: "" if not isinstance(value, str) else value[:30],
)
def test_contexts_that_multiply_work_are_refused_before_expansion(
    document: object, message: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Scoped, nested, repeated and oversized contexts never get to the parser that expands them."""
    monkeypatch.setattr(parsing, "oxigraph_parse", lambda *_, **__: pytest.fail("the contexts are expanded"))
    with pytest.raises(ParseError, match=message):
        _parse_json(document)


@pytest.mark.parametrize(
    "body",
    [b'{"urn:p": "\\ud800"}', b'{"\\ud800": 1}', b'{"urn:p": "\\\\\\udc00x"}', b'{"urn:p":\n "\\ud83d\\ud83d"}'],
)
def test_lone_surrogates_are_refused_where_they_stand(body: bytes) -> None:
    """Half of a surrogate pair is no character: the message names it, with line and column."""
    with pytest.raises(ParseError, match=r"\\ud... is half of a surrogate pair") as caught:
        _parse_json(body)
    assert caught.value.line == body.count(b"\n") + 1
    assert caught.value.column is not None


def test_escapes_that_look_like_surrogates_are_taken() -> None:
    """A pair is one character, and a backslash before a u is no escape."""
    (triple,) = _parse_json(b'{"urn:p": "\\ud83e\\udd16 \\\\ud800 \\u00e9"}')
    assert triple.object == Literal("\U0001f916 \\ud800 \u00e9")
