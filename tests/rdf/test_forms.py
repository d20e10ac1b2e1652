"""Documents that are filled in equal those that are written, byte for byte, whatever names and values they have."""

from typing import Any

import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from pyoxigraph import BlankNode, Literal, NamedNode

from linked_fleet_rdf.forms import MAX_TEMPLATES, FormTemplates
from linked_fleet_rdf.graph import Graph, Node, Term
from linked_fleet_rdf.serialise import TEXT_TYPES, WriteError, render
from linked_fleet_rdf.vocabulary import DCTERMS, LF, PREFIXES, RDF, XSD

ROOT = "http://fleet.example:8000"
_SEGMENTS = st.sampled_from(["a", "b", "ab", "a-b", "_x", "~y", "1", "é", "a.b", "a:b", "a%20b", "rotation"])
_PATHS = st.lists(_SEGMENTS, max_size=4).map(lambda segments: "".join(f"/{each}" for each in segments))
_OWN = st.builds(
    lambda path, end: NamedNode(ROOT + (path + end or "/")), _PATHS, st.sampled_from(["", "/", "#x", "?q", "#", "//"])
)
_FOREIGN = st.sampled_from(
    [LF.unknown, LF.Robot, RDF.nil, *map(NamedNode, ("urn:x:y", f"{ROOT}0/a", "http://fleet.example/a"))]
)
_BLANK = st.integers(1, 4).map(lambda number: BlankNode(f"b{number}"))
_TEXTS = st.one_of(
    st.sampled_from(
        ["1", "-1", "01", "-0", "0", "1.5", "1.5E0", "2e-06", "NaN", "true", "", " ", "%s", "a%", "0\0", "m"]
    ),
    st.text(st.characters(codec="utf-8", exclude_categories=["Cc", "Cs", "Cn"]), max_size=6),
)
_DATATYPES = (XSD.string, XSD.float, XSD.double, XSD.integer, XSD.decimal, XSD.boolean, XSD.dateTime, LF.unknown)
_LITERALS = st.one_of(
    st.builds(lambda text, datatype: Literal(text, datatype=datatype), _TEXTS, st.sampled_from(_DATATYPES)),
    _TEXTS.map(lambda text: Literal(text, language="en")),
)
_PREDICATES = st.one_of(st.sampled_from([RDF.type, RDF.first, RDF.rest, DCTERMS.title, LF.value]), _OWN)
_STATEMENTS = st.lists(
    st.tuples(st.one_of(_OWN, _BLANK), _PREDICATES, st.one_of(_OWN, _FOREIGN, _BLANK, _LITERALS)), max_size=8
)
_ELSEWHERE, _OWN_PART = NamedNode(f"{ROOT}/a/b"), NamedNode(f"{ROOT}/a/b/rotation")
Statements = list[tuple[Node, NamedNode, Term]]


def _graph(*statements: tuple[Node, NamedNode, Term]) -> Graph:
    """Return the graph. Equal terms are the same object, as in descriptions."""
    graph, terms = Graph(), dict[Term, Any]()
    for each in statements:
        graph.add(*(terms.setdefault(term, term) for term in each))
    return graph


def _written(graph: Graph, media_type: str, base: str) -> bytes | None:
    try:
        return render(graph.triples, media_type, PREFIXES, base=base)
    except WriteError:
        return None


def _filled(templates: FormTemplates, graph: Graph, media_type: str, base: str) -> bytes | None:
    try:
        return templates.render(graph, media_type, PREFIXES, base=base)
    except WriteError:
        return None


@given(_STATEMENTS, _STATEMENTS, _OWN)
@example(
    [(_ELSEWHERE, DCTERMS.title, Literal("a")), (_OWN_PART, LF.value, _ELSEWHERE), (_OWN_PART, LF.value, Literal("b"))],
    [],
    _OWN_PART,
)
def test_any_description(one: Statements, other: Statements, of: NamedNode) -> None:
    """The first and second of a form, those after them, and others between."""
    templates = FormTemplates()
    for media_type in TEXT_TYPES:
        for statements in (one, other, one, other, one):
            graph = _graph(*statements)
            assert _filled(templates, graph, media_type, of.value) == _written(graph, media_type, of.value)


def _thing(robot: str, joint: str, neighbour: str, title: str, value: str) -> tuple[Graph, str]:
    iri = NamedNode(f"{ROOT}/{robot}/{joint}")
    own, scalar = NamedNode(f"{iri.value}/rotation"), BlankNode("b1")
    graph = _graph(
        (iri, RDF.type, LF.Joint),
        (iri, DCTERMS.title, Literal(title)),
        (iri, LF.parentJoint, NamedNode(f"{ROOT}/{robot}/{neighbour}")),
        (iri, LF.lease, NamedNode(f"{ROOT}/{robot}/lease")),
        (iri, LF.value, own),
        (own, LF.value, scalar),
        (scalar, LF.value, Literal(value, datatype=XSD.float)),
        (scalar, LF.byteOffset, Literal("12", datatype=XSD.integer)),
        (scalar, LF.status, Literal(f"{len(title)}.50", datatype=XSD.decimal)),
    )
    return graph, iri.value


@pytest.mark.parametrize("media_type", TEXT_TYPES)
def test_things_of_one_form_share_a_template(media_type: str) -> None:
    templates = FormTemplates()
    for named in (
        ("r", "j", "k", "a title", "0.5"),
        ("robot", "elbow", "wrist", "elbow of robot", "-1.25"),
        ("x", "y", "z", "y: 12 (b)", "1e-05"),
    ):
        graph, base = _thing(*named)
        assert templates.render(graph, media_type, PREFIXES, base=base) == _written(graph, media_type, base)
    assert len(templates) == 1


@pytest.mark.parametrize("media_type", TEXT_TYPES)
def test_values_written_differently_have_another_template(media_type: str) -> None:
    """Names that are equal by chance, texts with quotes, and names with a colon."""
    templates = FormTemplates()
    for named in (
        ("r", "j", "k", "t", "0.5"), ("r", "j", "k", "t", "0.5"),
        ("r", "r", "k", "t", "0.5"), ("r", "j", "j", "t", "0.5"),
        ("r", "j", "k", 'a "t"', "0.5"), ("r", "j", "a:b", "t", "0.5"), ("r", "j", "k", "<t>", "0.5"),
    ):  # fmt: skip
        graph, base = _thing(*named)
        assert templates.render(graph, media_type, PREFIXES, base=base) == _written(graph, media_type, base)


def test_labels_of_blank_nodes_do_not_matter() -> None:
    """A parser gives each a new one."""
    templates, base = FormTemplates(), f"{ROOT}/a"
    for label in ("b1", "a", "shape-7"):
        graph = _graph(*[(BlankNode(label), LF.value, Literal(text)) for text in ("x", label)])
        assert templates.render(graph, "text/turtle", PREFIXES, base=base) == _written(graph, "text/turtle", base)
    assert len(templates) == 1


def test_they_are_bounded() -> None:
    """The oldest are dropped first."""
    templates = FormTemplates()
    iri = NamedNode(f"{ROOT}/a")
    for number in range(MAX_TEMPLATES + 1):
        graph = _graph((iri, LF.value, NamedNode(f"urn:x:{number}")))
        for _ in range(2):
            templates.render(graph, "text/turtle", PREFIXES, base=iri.value)
    assert len(templates) == MAX_TEMPLATES
