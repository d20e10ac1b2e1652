"""The paper's figures are served by the running Baxter (corrections: docs/PAPER.md)."""

from pathlib import Path

import pytest
import rdflib
from rdflib import BNode, Literal, URIRef
from rdflib.collection import Collection
from rdflib.compare import graph_diff, isomorphic, to_isomorphic

from browser import DCTERMS, HYBRIT, LF, RDFS, SH, VOM, Browser

pytestmark = pytest.mark.virtual
_GOLDEN = Path(__file__).parents[1] / "golden"


def _golden(name: str, robot: str) -> rdflib.Graph:
    text = (_GOLDEN / name).read_text().replace("http://example.org/baxter/", robot)
    return rdflib.Graph().parse(data=text, format="turtle")


def _same(served: rdflib.Graph, golden: rdflib.Graph) -> None:
    if not isomorphic(served, golden):
        _, extra, missing = graph_diff(to_isomorphic(served), to_isomorphic(golden))
        raise AssertionError(f"extra:\n{extra.serialize()}\nmissing:\n{missing.serialize()}")


def _part(served: rdflib.Graph, golden: rdflib.Graph, root: object) -> rdflib.Graph:
    """Return what ``served`` says of ``root`` in the figure's terms, with blank nodes below; numbers become zero."""
    found = rdflib.Graph()
    pending = [root]
    while pending:
        node = pending.pop()
        for predicate, value in served.predicate_objects(node):
            named = isinstance(value, BNode) or (None, None, value) in golden
            if (None, predicate, None) not in golden or not (named or predicate == VOM.numericalValue):
                continue
            zero = Literal("0", datatype=rdflib.XSD.float)
            found.add((node, predicate, zero if predicate == VOM.numericalValue else value))
            if isinstance(value, BNode):
                pending.append(value)
    return found


def _numbers_as_floats(graph: rdflib.Graph) -> rdflib.Graph:
    """Axes compare by value: "1" and "1.0" are the same xsd:float."""
    found = rdflib.Graph()
    for s, p, o in graph:
        is_float = isinstance(o, Literal) and o.datatype == rdflib.XSD.float
        found.add((s, p, Literal(repr(float(o)), datatype=rdflib.XSD.float) if is_float else o))
    return found


def test_figure_2b_joint(browser: Browser) -> None:
    """Every triple of Figure 2b, and no other value for one of its predicates."""
    page = browser.part("baxter", "right_s1")
    golden = _golden("figure_2b.ttl", browser.robot("baxter").url)
    _same(_part(page.graph, golden, page.iri), golden)


def test_figure_3_property(browser: Browser) -> None:
    """Figure 3, by following hybrit:property of right_s1 to its rotation."""
    joint = browser.part("baxter", "right_s1")
    page = browser.page(str(joint.one(URIRef("http://ros.org/#rotation"))))
    golden = _numbers_as_floats(_golden("figure_3.ttl", browser.robot("baxter").url))
    _same(_part(_numbers_as_floats(page.graph), golden, page.iri), golden)


def test_figure_2a_blueprint(browser: Browser) -> None:
    """Figure 2a: the four property shapes of the figure are in the blueprint of right_s1."""
    joint = browser.part("baxter", "right_s1")
    shape = URIRef("http://ros.org/#RevoluteJointShape")
    (url,) = [o for o in joint.graph.objects(joint.iri, HYBRIT.blueprint) if o != shape]
    served = browser.page(str(url)).graph
    golden = _golden("figure_2a.ttl", browser.robot("baxter").url)
    part = rdflib.Graph()
    part += [t for t in served.triples((shape, None, None)) if t[1] in (rdflib.RDF.type, SH.targetClass)]
    for node in served.objects(shape, SH.property):
        path = served.value(node, SH.path)
        (same,) = list(golden.subjects(SH.path, path)) or [None]
        if same is not None:
            terms = set(golden.predicates(same))
            part.add((shape, SH.property, node))
            part += [t for t in served.triples((node, None, None)) if t[1] in terms]
    _same(part, golden)


def test_figure_5a_action(browser: Browser) -> None:
    """Figure 5a: the description of rotate; without texts, optional additions and further links."""
    joint = browser.part("baxter", "right_s1")
    page = browser.page(browser.action(joint, LF.Rotate))
    words = (DCTERMS.title, DCTERMS.identifier, RDFS.comment, SH.name, SH.description)
    for predicate in (*words, RDFS.seeAlso, LF.invocations, LF.dryRun):
        page.graph.remove((None, predicate, None))
    page.graph.remove((page.iri, rdflib.RDF.type, LF.Rotate))
    for path in (LF.speed, LF.speedScale, LF.precondition, LF.tiedTo, LF.path, LF.plan, LF.mayTouch):
        (option,) = page.graph.subjects(SH.path, path)
        assert page.graph.value(option, SH.minCount) is None
        _cut(page.graph, option)
    _same(page.graph, _golden("figure_5a.ttl", browser.robot("baxter").url))


def _cut(graph: rdflib.Graph, node: rdflib.term.Node) -> None:
    """Remove the facts about a blank node, and those below it."""
    graph.remove((None, None, node))
    for _, predicate, value in list(graph.triples((node, None, None))):
        graph.remove((node, predicate, value))
        if isinstance(value, BNode):
            _cut(graph, value)


def test_figure_5a_lists_are_rdf_collections(browser: Browser) -> None:
    """The units in the shape are a well-formed list, degree first."""
    page = browser.page(browser.action(browser.part("baxter", "right_s1"), LF.Rotate))
    shape = page.graph.value(page.iri, HYBRIT.consumes)
    properties = list(page.graph.objects(shape, SH.property))
    (unit,) = [each for each in properties if page.graph.value(each, SH.path) == VOM.unit]
    units = Collection(page.graph, page.graph.value(unit, SH["in"]))
    assert "Degree" in str(units[0])
