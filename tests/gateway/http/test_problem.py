"""RFC 9457, in JSON and in RDF."""

import json

import pytest
from pyoxigraph import BlankNode, Literal, NamedNode, Triple

from linked_fleet_base import errors
from linked_fleet_gateway.extensions.pages.extension import Pages
from linked_fleet_gateway.http.problem import problem_body
from linked_fleet_rdf.parsing import parse
from linked_fleet_rdf.vocabulary import XSD

SH = "http://www.w3.org/ns/shacl#"
PREFIXES = {"sh": SH, "lf": "https://w3id.org/linked-fleet#", "dcterms": "http://purl.org/dc/terms/"}
BASE = "http://127.0.0.1:8000/baxter/right_s1/actions/rotate"
BROWSER = "text/html,application/xhtml+xml,application/xml;q=0.9,*/*;q=0.8"
REPORT = [
    Triple(BlankNode("r"), NamedNode(SH + "result"), BlankNode("v")),
    Triple(BlankNode("v"), NamedNode(SH + "resultPath"), NamedNode("http://ros.org/#p")),
    Triple(BlankNode("v"), NamedNode(SH + "resultMessage"), Literal("too far")),
    Triple(BlankNode("v"), NamedNode(SH + "value"), Literal("400")),
]


def test_json_has_all_members() -> None:
    """Type, title, status, detail, instance, what would have been right, and the report."""
    error = errors.UnprocessableContent("out of limits", report=REPORT, constraint=BASE + "#shape")
    body, content_type = problem_body(error, "*/*", BASE, Pages())
    assert content_type == "application/problem+json"
    assert json.loads(body) == {
        "type": "https://w3id.org/linked-fleet/problems#unprocessable-content",
        "title": "The content breaks a constraint",
        "status": 422,
        "detail": "out of limits",
        "instance": BASE,
        "constraint": BASE + "#shape",
        "report": [{"path": "http://ros.org/#p", "message": "too far", "value": "400"}],
    }
    assert error.headers["Link"] == f'<{BASE}#shape>; rel="http://www.w3.org/ns/ldp#constrainedBy"'


@pytest.mark.parametrize(
    ("accept", "expected"),
    [
        (None, "application/problem+json"),
        ("*/*", "application/problem+json"),
        ("application/json", "application/problem+json"),
        ("application/json, text/html;q=0.9", "application/problem+json"),
        ("image/png", "application/problem+json"),
        ("text/event-stream", "application/problem+json"),
        ("text/html, */*", "application/problem+json"),
        (BROWSER, "text/html; charset=utf-8"),
        ("text/turtle", "text/turtle; charset=utf-8"),
        ("text/turtle, */*;q=0.1", "text/turtle; charset=utf-8"),
        ("application/ld+json", "application/ld+json"),
    ],
)
def test_negotiation(accept: str | None, expected: str) -> None:
    """JSON unless something else is clearly preferred; also if nothing is acceptable."""
    assert problem_body(errors.NotFound("no robot of this name"), accept, BASE, Pages())[1] == expected


@pytest.mark.parametrize(
    "accept", ["text/turtle", "application/ld+json", "application/n-triples", "application/rdf+xml"]
)
def test_rdf_carries_the_report(accept: str) -> None:
    """Problem and SHACL report in one graph."""
    body, content_type = problem_body(errors.UnprocessableContent("no", report=REPORT), accept)
    triples = parse(body, content_type.partition(";")[0], BASE)
    assert Literal("too far") in [t.object for t in triples]
    assert NamedNode("https://w3id.org/linked-fleet#Problem") in [t.object for t in triples]


@pytest.mark.parametrize(
    "accept", ["text/turtle", "application/ld+json", "application/n-triples", "application/rdf+xml"]
)
def test_each_refusal_has_its_own_texts(accept: str) -> None:
    """Refusals of one form, whatever characters their texts have."""
    for value in ("400", "401.5", '"%s" <a>\\', "-0.5 °", "402.5"):
        at, of = BlankNode(), f"{BASE}{len(value)}"
        about = [
            Triple(at, NamedNode(SH + "value"), Literal(value, datatype=kind))
            for kind in (XSD.string, XSD.decimal)
            if kind == XSD.string or value[0] == "4"
        ]
        about.append(Triple(at, NamedNode(SH + "focusNode"), NamedNode(of)))
        body, content_type = problem_body(errors.UnprocessableContent(f"not {value}", report=about), accept, of)
        parsed = parse(body, content_type.partition(";")[0], of)
        assert {t.object for t in parsed} >= {t.object for t in about} | {Literal(f"not {value}")}
        assert len(parsed) == len(about) + 5


def test_extension_members() -> None:
    """Each error states in fields what would have been right."""
    assert errors.MethodNotAllowed("no", allow=["GET", "HEAD"]).headers == {"Allow": "GET, HEAD"}
    assert errors.NotAcceptable("no", offered=["text/turtle"]).members == {"offered": ["text/turtle"]}
    assert errors.BadRequest("no", line=2, column=3).members == {"line": 2, "column": 3}
    assert (
        str(errors.Offline("baxter was last seen at noon")) == "503 The robot is offline: baxter was last seen at noon"
    )


def test_printed_tree_is_the_tree() -> None:
    """The tree in the module's docstring lists every error with its status and code."""

    def below(kind: type[errors.FleetError]) -> set[type[errors.FleetError]]:
        return {kind}.union(*(below(child) for child in kind.__subclasses__()))

    lines = [line.split() for line in (errors.__doc__ or "").splitlines() if line.strip()[-1:].isalpha()]
    printed = {tuple(words[-3:]) for words in lines if len(words) > 2 and words[-2].isdigit()}
    found = {kind for kind in below(errors.FleetError) if kind.__module__ == errors.__name__} - {errors.FleetError}
    assert printed == {(kind.__name__, str(kind.status), kind.code) for kind in found}
