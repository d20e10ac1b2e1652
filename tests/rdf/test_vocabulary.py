"""The document at /vocabulary: valid SHACL in every syntax, with every shape that documents refer to."""

from collections.abc import Iterable, Mapping
from itertools import chain, combinations

import pyshacl
import pytest
import rdflib
from pyoxigraph import BlankNode, Literal, NamedNode, RdfFormat, Triple

from all_terms import LF
from graphs import read
from linked_fleet_gateway.resources.resource import Resource
from linked_fleet_rdf.serialise import JELLY, RDF_TYPES, render
from linked_fleet_rdf.shapes import load_turtle
from linked_fleet_rdf.vocabulary import DCTERMS, HYBRIT, LDP, PREFIXES, RDF, RDFS, SH
from sample_resources import BASE, described, described_paths, tree

_IRI = NamedNode(BASE + "/vocabulary")
_ONTOLOGY = NamedNode("http://www.w3.org/2002/07/owl#Ontology")
_NAMES = ("vocabulary.ttl", "blueprints.ttl", "subscriptions.ttl", "actions")
_NAMES_A_SHAPE = (HYBRIT.blueprint, HYBRIT.consumes, HYBRIT.produces, LDP.constrainedBy, LF.shape, SH.node, SH.property)
_SYNTAXES: Mapping[str, str] = {
    "text/turtle": "turtle",
    "application/n-triples": "nt",
    "application/rdf+xml": "xml",
    JELLY: "jelly",
}
_PREFIXES = "".join(f"@prefix {prefix}: <{iri}> .\n" for prefix, iri in PREFIXES.items())
_SUBSCRIPTION = "<#s> a hybrit:Subscription ; hybrit:onResource <#r> ; lf:minimumInterval {interval} ."
_RULE = '<#r> a lf:Rule ; lf:condition "SELECT" ; lf:invokes <#a> ; lf:minimumInterval {interval} {title} .'


def _vocabulary() -> list[Triple]:
    return described(tree(), "/vocabulary")


def _read(media_type: str) -> rdflib.Graph:
    """Return the document as parsed by rdflib in this syntax."""
    body = render(_vocabulary(), media_type, PREFIXES, base=_IRI.value)
    if media_type == "application/ld+json":  # rdflib's parser uses deprecated functions of rdflib
        return read(body, _IRI.value, RdfFormat.JSON_LD)
    return rdflib.Graph().parse(data=body, format=_SYNTAXES[media_type], publicID=_IRI.value)


def _conforms(data: str, shapes: rdflib.Graph) -> bool:
    graph = rdflib.Graph().parse(data=_PREFIXES + data, format="turtle", publicID="http://client.example/")
    return bool(pyshacl.validate(graph, shacl_graph=shapes, inference="none", meta_shacl=False)[0])


@pytest.mark.parametrize("media_type", RDF_TYPES)
def test_pyshacl_loads_the_vocabulary_and_judges_by_it(media_type: str) -> None:
    """The targets of ldp:constrainedBy are served as in the file, in each syntax."""
    shapes = _read(media_type)
    assert _conforms(_SUBSCRIPTION.format(interval="1.5"), shapes)
    assert not _conforms(_SUBSCRIPTION.format(interval="-1"), shapes)
    assert _conforms(_RULE.format(interval="0.5", title='; dcterms:title "a rule"'), shapes)
    assert not _conforms(_RULE.format(interval="0.5", title=""), shapes)
    for shape in (LF.SubscriptionShape, LF.RuleShape, LF.SceneObjectInput):
        assert (rdflib.URIRef(shape.value), rdflib.SH.property, None) in shapes


def test_each_property_of_a_shape_has_one_path() -> None:
    """SHACL 2.3.1: properties merged from several files stay separate."""
    triples = _vocabulary()
    shapes = [t.object for t in triples if t.predicate == SH.property]
    assert len(shapes) > 30
    for shape in shapes:
        assert len([t for t in triples if t.subject == shape and t.predicate == SH.path]) == 1, shape


def _blank_nodes(triples: Iterable[Triple]) -> set[object]:
    return {term for triple in triples for term in triple if isinstance(term, BlankNode)}


def test_files_share_no_blank_node() -> None:
    nodes = [_blank_nodes(chain.from_iterable(load_turtle(each).values())) for each in _NAMES]
    assert all(nodes)
    assert not any(one & other for one, other in combinations(nodes, 2))


def test_the_document_says_what_it_is() -> None:
    """R1.3: by a type of its own, not only by those of its terms."""
    triples = _vocabulary()
    assert {t.object for t in triples if t.subject == _IRI and t.predicate == RDF.type} == {_ONTOLOGY, LDP.RDFSource}
    assert any(t.subject == _IRI and t.predicate == DCTERMS.title for t in triples)


def test_every_shape_that_a_document_names_is_described() -> None:
    """By its type, a label and a comment; shapes under the IRI of this server are in the documents there."""
    here = tree()
    named: set[NamedNode] = set()
    for path in described_paths(here):
        triples = described(here, path)
        found = {t.object for t in triples if t.predicate in _NAMES_A_SHAPE and isinstance(t.object, NamedNode)}
        own = {iri for iri in found if iri.value.startswith(BASE)}
        named |= found - own
        for iri in own:
            assert isinstance(here.resolve(iri.value.removeprefix(BASE).partition("#")[0]), Resource), iri
    assert len(named) > 50
    said: dict[object, set[NamedNode]] = {}
    for triple in _vocabulary():
        said.setdefault(triple.subject, set()).add(triple.predicate)
    label = NamedNode(RDFS.iri + "label")
    incomplete = [iri.value for iri in named if not {RDF.type, label, RDFS.comment} <= said.get(iri, set())]
    assert not incomplete


def test_no_term_doubles_one_of_a_standard_vocabulary() -> None:
    """R1.5: Dublin Core, RDF Schema and LDP already have these."""
    ours = {iri.value.removeprefix(LF.iri) for iri in load_turtle("vocabulary.ttl") if iri.value.startswith(LF.iri)}
    assert not ours & {*DCTERMS.terms, *RDFS.terms, *LDP.terms, "label", "modified", "creator", "member"}


def test_labels_and_comments_are_text() -> None:
    for triple in _vocabulary():
        if triple.predicate == RDFS.comment:
            assert isinstance(triple.object, Literal) and triple.object.value.endswith("."), triple
