"""Paper 5.1: every representation conforms to its own blueprint, as both are served; less than that does not."""

import pyshacl
import pytest
import rdflib
from browser import HYBRIT, SH
from walk import Visited, Walk

pytestmark = pytest.mark.fleet


def _blueprint(tree: Walk, page: Visited) -> rdflib.Graph:
    (url,) = [str(b) for b in page.graph.objects(page.iri, HYBRIT.blueprint) if str(b) in tree.pages]
    return tree.pages[url].graph


def _conforms(data: rdflib.Graph, shapes: rdflib.Graph) -> tuple[bool, str]:
    conforms, _, text = pyshacl.validate(data, shacl_graph=shapes, inference="none")
    return bool(conforms), text


def _targets(page: Visited, shapes: rdflib.Graph) -> set[object]:
    types = set(page.graph.objects(page.iri, rdflib.RDF.type))
    return {shape for shape, target in shapes.subject_objects(SH.targetClass) if target in types}


@pytest.mark.parametrize("kind", ["fleet", "robot", "joint", "link", "property"])
def test_everything_conforms_to_its_own_blueprint(tree: Walk, kind: str) -> None:
    """Every resource of all five robots is a target of its blueprint, and conforms."""
    # One resource per kind and shape suffices for the constant ones; every joint and link is checked.
    for page in tree.of(kind):
        shapes = _blueprint(tree, page)
        assert _targets(page, shapes), f"{page.url} is no target of its own blueprint"
        conforms, text = _conforms(page.graph, shapes)
        assert conforms, f"{page.url}\n{text}"


def test_taking_a_required_triple_away_fails(tree: Walk) -> None:
    """For one resource per shape: each predicate of the focus node that a shape counts is really required."""
    seen: set[frozenset[object]] = set()
    for page in tree.of("robot", "joint", "link", "property"):
        shapes = _blueprint(tree, page)
        targets = frozenset(_targets(page, shapes))
        if targets in seen:
            continue
        seen.add(targets)
        for predicate in _required(shapes, targets):
            less = rdflib.Graph()
            less += page.graph
            less.remove((page.iri, predicate, None))
            assert not _conforms(less, shapes)[0], f"{page.url} conforms without {predicate}"
    assert len(seen) > 10


def test_taking_a_value_away_fails(tree: Walk) -> None:
    """Deep down as well: a rotation without its number, its unit or its axis does not conform."""
    page = next(page for page in tree.of("property") if page.url.endswith("/right_s1/rotation"))
    shapes = _blueprint(tree, page)
    nested = [t for t in page.graph if isinstance(t[0], rdflib.BNode)]
    assert len(nested) >= 8
    for triple in nested:
        less = rdflib.Graph()
        less += page.graph
        less.remove(triple)
        assert not _conforms(less, shapes)[0], triple


def _required(shapes: rdflib.Graph, targets: frozenset[object]) -> set[rdflib.URIRef]:
    found: set[rdflib.URIRef] = set()
    for shape in targets:
        for node in [shape, *shapes.objects(shape, SH.node)]:
            for each in shapes.objects(node, SH.property):
                count = shapes.value(each, SH.minCount)
                if count is not None and int(count) > 0:
                    found.add(shapes.value(each, SH.path))
    return found
