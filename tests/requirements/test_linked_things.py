"""R1.1 to R1.12 of the paper, each on every Linked Robotic Thing of the tree."""

from collections.abc import Sequence

import httpx
import pytest
import rdflib
from pyoxigraph import BlankNode, CanonicalizationAlgorithm, Dataset, RdfFormat, Triple, parse
from rdflib import RDF, URIRef

from browser import DCTERMS, HYBRIT, LF, RDFS, SOSA, VOM
from walk import WALKED, Walk

pytestmark = pytest.mark.virtual
ROBOTS = WALKED

_STANDARD = (
    str(RDF), str(RDFS), str(DCTERMS), str(SOSA), str(rdflib.PROV), str(rdflib.SH), "http://www.w3.org/ns/ldp#",
    "http://qudt.org/", "http://www.w3.org/1999/xhtml/vocab#", "http://www.w3.org/2011/http",
    "http://www.w3.org/2001/XMLSchema#", "http://vocab.arvida.de/2015/06/", "http://ros.org/#", str(HYBRIT),
    "http://www.w3.org/2002/07/owl#", "http://www.w3.org/ns/hydra/core#", "http://rdfs.org/ns/void#",
    "http://www.w3.org/ns/sparql-service-description#",
)  # fmt: skip


def test_r1_1_linked_robotic_things_are_robotic_things(tree: Walk) -> None:
    """R1.1: every LRT is a hybrit:RoboticThing; there are robots with joints and links."""
    assert len(tree.of("robot")) == len(ROBOTS)
    for page in tree.things():
        assert HYBRIT.RoboticThing in set(page.graph.objects(page.iri, RDF.type)), page.url


def test_r1_2_turtle_unless_negotiated(tree: Walk, http: httpx.Client) -> None:
    """R1.2: Turtle by default, with prefixes; other types by Accept, with Vary."""
    for page in tree.things():
        assert page.response.headers["content-type"] == "text/turtle; charset=utf-8"
        assert "@prefix" in page.response.text
        vary = "Accept, Prefer" if page.url == tree.root else "Accept"
        assert page.response.headers["vary"] == f"{vary}, Accept-Encoding"
    for media_type in ("application/ld+json", "application/n-triples", "application/rdf+xml", "text/html"):
        for page in tree.things()[::20]:
            answer = http.get(page.url, headers={"accept": f"{media_type};q=0.9, text/turtle;q=0.1"})
            assert answer.headers["content-type"].startswith(media_type), page.url


def test_r1_2_all_rdf_types_say_the_same(tree: Walk, http: httpx.Client) -> None:
    """R1.2: the constant resources are the same graph in every RDF type."""
    formats = {
        "text/turtle": RdfFormat.TURTLE,
        "application/ld+json": RdfFormat.JSON_LD,
        "application/n-triples": RdfFormat.N_TRIPLES,
        "application/rdf+xml": RdfFormat.RDF_XML,
    }
    for page in tree.of("action", "blueprint")[::40]:
        graphs = []
        for media_type, form in formats.items():
            body = http.get(page.url, headers={"accept": media_type}).content
            graph = Dataset(parse(body, format=form, base_iri=page.url))
            graph.canonicalize(CanonicalizationAlgorithm.RDFC_1_0)
            graphs.append(graph)
        assert all(graph == graphs[0] for graph in graphs), page.url


def test_r1_3_explicit_type_on_every_subject_of_its_own(tree: Walk) -> None:
    """R1.3: at least one rdf:type, stated and not inferred, on every resource."""
    for page in tree.of("fleet", "robot", "joint", "link", "property", "action", "container", "blueprint"):
        assert (page.iri, RDF.type, None) in page.graph, page.url


def test_r1_4_things_have_several_types(tree: Walk) -> None:
    """R1.4: clients meet several types on one resource."""
    assert all(len(set(page.graph.objects(page.iri, RDF.type))) > 1 for page in tree.things())


def test_r1_5_terms_are_standard_or_described(tree: Walk) -> None:
    """R1.5: every predicate and type is from a known vocabulary, or described in one that the fleet or a thing links.

    The input of an invocation is the client's: terms of other vocabularies stay in it.
    """
    (vocabulary,) = tree.pages[tree.root].graph.objects(URIRef(tree.root), LF.vocabulary)
    linked = {str(each) for page in tree for each in page.graph.objects(page.iri, LF.vocabulary)}
    known = {str(subject) for each in linked for subject in tree.pages[each].graph.subjects()}
    for page in tree:
        triples = page.triples()
        inputs = _inputs(triples)
        triples = [each for each in triples if each.subject not in inputs]
        used = {each.predicate.value for each in triples}
        used |= {each.object.value for each in triples if each.predicate.value == str(RDF.type)}
        for term in used:
            assert term.startswith(_STANDARD) or term in known, f"{term} at {page.url}"
    assert (LF.Robot, RDF.type, None) in tree.pages[str(vocabulary)].graph


def _inputs(triples: Sequence[Triple]) -> set[object]:
    """Return the nodes of the inputs of invocations."""
    found = [each.object for each in triples if each.predicate.value == str(LF.input)]
    for node in found:  # it grows
        found += [t.object for t in triples if t.subject == node and isinstance(t.object, BlankNode)]
    return set(found)


def test_r1_6_things_of_a_type_differ_in_predicates(tree: Walk) -> None:
    """R1.6: links do not all have the same predicates (the root link has no parent joint)."""
    assert len({frozenset(page.graph.predicates(page.iri)) for page in tree.of("link")}) > 1


def test_r1_7_no_inference_needed(tree: Walk) -> None:
    """R1.7: super-classes and super-properties are stated: joints are lf:Joint, containers are ldp:Container."""
    for page in tree.of("joint"):
        assert LF.Joint in set(page.graph.objects(page.iri, RDF.type))
        named = {o for p in page.graph.predicates(page.iri) for o in page.graph.objects(page.iri, p)}
        properties = set(page.graph.objects(page.iri, HYBRIT.property))
        assert properties <= named
    for page in tree.of("container", "fleet"):
        assert rdflib.URIRef("http://www.w3.org/ns/ldp#Container") in set(page.graph.objects(page.iri, RDF.type))


def test_r1_8_every_thing_has_its_subscriptions_container(tree: Walk) -> None:
    """R1.8: an LDP container on every LRT, which leads to the shape of what it takes."""
    for page in tree.things():
        (iri,) = page.graph.objects(page.iri, HYBRIT.subscriptions)
        container = tree.pages[str(iri)]
        assert container.kind == "container"
        (shape,) = container.graph.objects(container.iri, URIRef("http://www.w3.org/ns/ldp#constrainedBy"))
        (vocabulary,) = container.graph.objects(container.iri, LF.vocabulary)
        assert (shape, RDF.type, rdflib.SH.NodeShape) in tree.pages[str(vocabulary)].graph


def test_r1_9_things_expose_properties(tree: Walk) -> None:
    """R1.9: hybrit:property names property resources, and each is its own document."""
    for page in tree.of("robot", "joint", "link"):
        properties = list(page.graph.objects(page.iri, HYBRIT.property))
        assert properties
        assert all(tree.pages[str(each)].kind == "property" for each in properties), page.url


def test_r1_10_joints_that_take_commands_expose_actions(tree: Walk) -> None:
    """R1.10: hybrit:action on every revolute, continuous and prismatic joint that mimics no other, and on no other."""
    for page in tree.of("joint"):
        actions = list(page.graph.objects(page.iri, HYBRIT.action))
        moves = (page.iri, LF.velocity, None) in page.graph
        mimics = (page.iri, LF.mimic, None) in page.graph
        assert bool(actions) == (moves and not mimics), page.url
        assert all(tree.pages[str(each)].kind == "action" for each in actions)


def test_r1_11_blueprints_are_dereferenceable(tree: Walk) -> None:
    """R1.11: one of the blueprints of each thing and property is a document of shapes."""
    for page in tree.of("fleet", "robot", "joint", "link", "property"):
        own = [b for b in page.graph.objects(page.iri, HYBRIT.blueprint) if str(b) in tree.pages]
        assert [tree.pages[str(b)].kind for b in own] == ["blueprint"], page.url


def test_r1_12_robots_carry_their_own_annotations(tree: Walk) -> None:
    """R1.12: what the agent adds to its description is in that of the robot."""
    for page in tree.of("robot"):
        assert (page.iri, RDFS.comment, None) in page.graph, page.url


def test_every_scalar_has_a_unit(tree: Walk) -> None:
    """Values carry their unit: no vom:numericalValue without vom:unit, and in no document a NaN."""
    for page in tree.of("joint", "link", "property"):
        for node in page.graph.subjects(VOM.numericalValue):
            assert (node, VOM.unit, None) in page.graph, page.url
        assert '"NaN"' not in page.response.text
