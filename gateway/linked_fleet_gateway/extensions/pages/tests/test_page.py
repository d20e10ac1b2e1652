"""Pages of hostile and odd graphs, without a gateway."""

import pytest
from pyoxigraph import BlankNode, Literal, NamedNode, Triple

from dom import parsed
from linked_fleet_base import errors
from linked_fleet_gateway.extensions.pages import texts
from linked_fleet_gateway.extensions.pages.extension import Pages
from linked_fleet_gateway.extensions.pages.page import write
from linked_fleet_gateway.http.problem import problem
from linked_fleet_gateway.http.representation import FORMATS
from linked_fleet_gateway.resources.html import PageContext, Reader
from linked_fleet_gateway.resources.resource import Resource
from linked_fleet_rdf.serialise import parse
from linked_fleet_rdf.vocabulary import DCTERMS, HYBRIT, LF, MATHS, QUDT, RDF, RDFS, UNIT, VOM, XSD

BASE = "http://example.org"
HERE = NamedNode(BASE + "/r/")
EVIL = (
    "</script><script>alert(1)</script>",
    "<!--<script>",
    '" onload="alert(1)',
    "'><img src=x onerror=alert(1)>",
    "\u202egnp.exe\u202c",
    "a\x00b\x08c\x1fd\x7f\x9fe\ufffe",
    "{{ 7 * 7 }}{% raw %}",
    "]]>&lt;&amp;&#60;",
)
NOBODY_READS = PageContext()
BROWSER = "text/html,application/xhtml+xml,application/xml;q=0.9,*/*;q=0.8"


def page(*triples: Triple, path: str = "/r/", title: str = "r", context: PageContext = NOBODY_READS) -> bytes:
    return write(Resource(path, title, lambda graph: None), triples, BASE, context, FORMATS)


def said(predicate: NamedNode, value: NamedNode | BlankNode | Literal) -> Triple:
    return Triple(HERE, predicate, value)


@pytest.mark.parametrize("evil", EVIL)
@pytest.mark.parametrize("kind", [LF.Robot, LF.Fleet, LF.Joint, HYBRIT.Property, HYBRIT.Action, LF.Invocation, None])
def test_texts_of_a_robot_are_escaped(evil: str, kind: NamedNode | None) -> None:
    """In titles, facts, language attributes and the embedded JSON-LD."""
    node = BlankNode("n")
    triples = [
        *([said(RDF.type, kind)] if kind else []),
        said(DCTERMS.title, Literal(evil)),
        said(RDFS.comment, Literal(evil, language="en")),
        said(LF.reason, Literal(evil)),
        said(LF.fault, Literal(evil)),
        said(NamedNode("http://other.example/p"), node),
        Triple(node, DCTERMS.title, Literal(evil)),
        said(LF.namedPose, node),
    ]
    body = page(*triples, title=evil)
    root = parsed(body)
    assert [each.get("type") for each in root.all("script")] in (
        ["application/ld+json"],
        ["module", "application/ld+json"],
    )
    (title,) = [each.text for each in root.all("h1")]
    assert title == texts.clean(evil)
    assert not [name for each in root.all() for name in each.attributes if name.startswith("on") or name == "style"]
    assert not set(range(32)) - {10} & set(body)
    data = next(each.text for each in root.all("script") if each["type"] == "application/ld+json")
    assert Literal(evil) in [each.object for each in parse(data.encode(), "application/ld+json", HERE.value)]


@pytest.mark.parametrize(
    ("given", "shown"),
    [("en de fr", "in de"), ("fr en", "in en"), ("fr", "in fr")],
)
def test_a_comment_is_shown_in_the_language_of_the_reader_if_it_is_known(given: str, shown: str) -> None:
    comments = [said(RDFS.comment, Literal(f"in {each}", language=each)) for each in given.split()]
    german = PageContext(Reader(languages="de"))
    root = parsed(page(said(RDF.type, LF.Robot), *comments, context=german))
    assert [each.text.strip() for each in root.all("p") if each.get("class") == "comment"] == [shown]


@pytest.mark.parametrize(
    "iri", ["javascript:alert(1)", "data:text/html,x", "vbscript:x", "urn:x", "file:///etc/passwd"]
)
def test_only_web_addresses_are_links(iri: str) -> None:
    root = parsed(page(said(RDFS.seeAlso, NamedNode(iri)), said(NamedNode(iri), Literal("x"))))
    assert not [each for each in root.all() for name in ("href", "src") if each.get(name).startswith(iri[:4])]
    assert iri in root.by_id("facts").text


def test_a_page_is_made_of_its_triples_alone() -> None:
    triples = [said(RDF.type, LF.Robot), said(DCTERMS.title, Literal("R")), said(LF.presence, LF.online)]
    assert page(*triples) == page(*triples)


def test_deep_and_tangled_nodes_are_shown_once_each() -> None:
    """An extremely deep chain, nodes that are referred to twice at each step, and a cycle."""
    chain = [Triple(BlankNode(f"c{i}"), RDFS.seeAlso, BlankNode(f"c{i + 1}")) for i in range(500)]
    twice = [
        Triple(BlankNode(f"t{i}"), predicate, BlankNode(f"t{i + 1}"))
        for i in range(40)
        for predicate in (RDFS.seeAlso, DCTERMS.hasPart)
    ]
    ring = [
        Triple(BlankNode("r0"), RDFS.seeAlso, BlankNode("r1")),
        Triple(BlankNode("r1"), RDFS.seeAlso, BlankNode("r0")),
    ]
    starts = [said(RDFS.seeAlso, BlankNode(each)) for each in ("c0", "t0", "r0")]
    body = page(*starts, *chain, *twice, *ring)
    parsed(body)
    assert len(body) < 500_000


def mass(label: str) -> list[Triple]:
    node, radian = BlankNode(label), Literal("0.5235988", datatype=XSD.float)
    return [
        said(LF.mass, node),
        Triple(node, RDF.type, MATHS.Scalar),
        Triple(node, VOM.numericalValue, radian),
        Triple(node, VOM.unit, MATHS.Radian),
        Triple(node, QUDT.unit, UNIT.RAD),
    ]


def test_numbers_have_units_and_where_they_are() -> None:
    """A scalar in a node is live, one of several of its kind is not."""
    (number,) = parsed(page(*mass("a"))).all("data")
    assert number.attributes == {
        "data-subject": HERE.value,
        "data-path": f"{LF.mass.value} {VOM.numericalValue.value}",
        "value": "0.5235988",
        "data-unit": "rad",
    }
    assert number.parent is not None and number.parent.text.split() == ["0.5236", "rad", "30°"]
    both = parsed(page(*mass("a"), *mass("b"))).all("data")
    assert [set(each.attributes) for each in both] == [{"value", "data-unit"}] * 2


def test_an_unknown_value_is_no_number() -> None:
    node = BlankNode("a")
    (number,) = parsed(page(said(LF.mass, node), Triple(node, VOM.numericalValue, LF.unknown))).all("data")
    assert (number["value"], number.text) == ("", "unknown")


@pytest.mark.parametrize(
    ("value", "unit", "text"),
    [
        (0.0, "", "0"), (-0.0, "", "0"), (-0.00001, "", "-0.00001"), (1.0, "", "1"), (0.52359877, "rad", "0.5236"),
        (-3.14159265, "rad", "-3.1416"), (9999.9, "", "9999.9"), (86400.0, "s", "86400"), (0.00012, "", "0.0001"),
        (1234567.8, "", "1234567.8"), (1e20, "", "1·10²⁰"), (0.00001234, "", "0.000012"), (-2e-12, "", "-2·10⁻¹²"),
        (100.0, "", "100"), (12.3456, "N m", "12.35"), (-0.0004, "rad/s", "0"), (0.00001, "rad", "0"),
    ],
)  # fmt: skip
def test_numbers_are_written_as_the_scripts_write_them(value: float, unit: str, text: str) -> None:
    assert texts.number(value, unit) == text


def test_the_command_to_copy_is_quoted_for_a_shell() -> None:
    path = "/r/it's-$(x)"
    (command,) = [each.text for each in parsed(page(path=path)).all("code") if each.get("id") == "curl"]
    assert command == "curl -H 'Accept: text/turtle' " + "'" + BASE + path.replace("'", "'\"'\"'") + "'"


@pytest.mark.parametrize("path", ["/r/", "/r/?last=10s"])
def test_the_context_of_a_page_is_that_of_its_request(path: str) -> None:
    """Its reader, the warning, the query in the addresses of other formats, and whether subscriptions are linked."""
    of = Triple(NamedNode(BASE + path), HYBRIT.subscriptions, NamedNode(BASE + "/r/subscriptions"))
    context = PageContext(Reader("Ada", ("read",)), "last=10s", links_subscriptions=False, warning="Data are lost.")
    told = parsed(page(of, path=path, context=context))
    assert [each.text for each in told.all("bdi") if each.get("id") == "who"] == ["Ada"]
    assert [each.text for each in told.all("p") if each.get("id") == "warning"] == ["Data are lost."]
    links = [each.get("href") for each in told.all("a")]
    assert f"{BASE}/r/?as=turtle&last=10s" in links and f"{BASE}/r/subscriptions" not in links
    links = [each.get("href") for each in parsed(page(of, path=path)).all("a")]
    assert f"{BASE}/r/?as=turtle" in links and f"{BASE}/r/subscriptions" in links


@pytest.mark.parametrize(
    "error",
    [
        errors.NotFound('There is no <script>alert("x")</script>.'),
        errors.NotAcceptable("Available here: text/turtle.", offered=("text/turtle", "<b>")),
        errors.MisdirectedRequest("Known are http://example.org."),
        errors.Offline("r was last seen at noon"),
    ],
)
def test_a_refusal_is_a_page_for_a_browser(error: errors.FleetError) -> None:
    """With the text of the problem details, escaped, and under the same policy."""
    body, headers = problem(error, BROWSER, BASE + "/x<y", Pages())
    root = parsed(body)
    assert error.detail in root.text and error.title in root.text and str(error.status) in root.text
    assert not list(root.all("script", "b")) and "default-src 'none'" in headers["content-security-policy"]
    assert headers["content-type"] == "text/html; charset=utf-8"
