"""Histories that are filled into a known document have the bytes of those that are described statement by statement."""

import math

import pytest
from pyoxigraph import NamedNode

from linked_fleet_gateway.extensions.history.compiled import history_template
from linked_fleet_gateway.extensions.history.describe import Page, describe_property, page_of
from linked_fleet_gateway.extensions.history.resources import _is_short
from linked_fleet_gateway.extensions.history.span import Span, parse_span
from linked_fleet_gateway.extensions.history.tests.test_track import S, frame, track
from linked_fleet_gateway.extensions.history.track import Series, joint_series, link_series
from linked_fleet_gateway.resources.property import Property
from linked_fleet_gateway.resources.resource import Resource
from linked_fleet_gateway.resources.templates import Templates
from linked_fleet_rdf.graph import Graph
from linked_fleet_rdf.serialise import render
from linked_fleet_rdf.vocabulary import LF, PREFIXES

_BASE = "http://example.org:8000"
_TYPES = ("text/turtle", "application/ld+json")
_QUERIES = (
    [],
    [("limit", "1")],
    [("limit", "2")],
    [("limit", "5")],
    [("last", "PT4S"), ("limit", "3")],
    [("to", "1970-01-01T00:00:05Z")],
)


def _property(shape: NamedNode, title: str) -> Property:
    return Property("velocity", LF.velocity, (LF.ScalarProperty,), shape, title, lambda *_: None)


def _resource(page: Page, item: Property, series: Series, of: str) -> Resource:
    return Resource(f"{of}/history", "History", history_template(_BASE, of, item, series, page))


def _described(page: Page, item: Property, series: Series, of: str) -> Resource:
    def describe(graph: Graph) -> None:
        thing, robot = of.rpartition("/")[0], "/" + of.split("/")[1]
        iri, about, place, whole = (
            NamedNode(_BASE + each) for each in (f"{of}/history", of, thing, f"{robot}/history")
        )
        describe_property(graph, iri, about, place, whole, item, series, page)

    return Resource(f"{of}/history", "History", describe)


@pytest.mark.parametrize("media_type", _TYPES)
def test_a_filled_history_equals_the_described_one(media_type: str) -> None:
    """Whatever the number of samples, and for single numbers and vectors; one text serves all longer ones."""
    templates, kept = Templates(), track(*range(S, 30 * S, S))
    one, other = _property(LF.ScalarPropertyShape, "velocity of turn"), _property(LF.PoseShape, "pose of b")
    turning = joint_series(kept.joints, "turn", one)
    assert turning is not None
    for said in _QUERIES:
        span = parse_span(said)
        page = page_of(kept, span, span.observations)
        for of in ("/r/turn/velocity", "/q/q/velocity"):
            for item, series in ((one, turning), (other, link_series(kept.joints, "b"))):
                resource = _resource(page, item, series, of)
                found = templates.document(resource, media_type, _BASE)
                assert found is not None
                for described in (resource, _described(page, item, series, of)):
                    triples = described.full_graph(_BASE).triples
                    written = render(triples, media_type, PREFIXES, base=_BASE + resource.path)
                    assert found.content == written, (said, of, item.title)


def test_histories_of_other_lengths_share_a_text() -> None:
    templates, kept = Templates(), track(*range(S, 30 * S, S))
    item = _property(LF.ScalarPropertyShape, "velocity of turn")
    series = joint_series(kept.joints, "turn", item)
    assert series is not None
    for most in (3, 7, 20):
        page = Page(Span(begin_ns=0), kept.excerpt(0, None, most), kept.time_range, len(kept))
        resource = _resource(page, item, series, "/r/turn/velocity")
        assert templates.is_known(resource, "text/turtle", _BASE) == (most > 3)
        assert templates.document(resource, "text/turtle", _BASE) is not None


def test_unknown_values_are_described() -> None:
    kept = track(S)
    kept.append(frame(2 * S, math.nan), 1000 * S)
    item = _property(LF.ScalarPropertyShape, "velocity of turn")
    series = joint_series(kept.joints, "turn", item)
    assert (
        series is not None
        and history_template(_BASE, "/r/turn/velocity", item, series, page_of(kept, Span(), 9)) is None
    )


def test_long_pages_are_left_to_a_thread() -> None:
    """Pages of vectors are long earlier, because each pose is computed."""
    kept = track(*range(S, 300 * S, S))
    item = _property(LF.ScalarPropertyShape, "velocity of turn")
    turning, posed = joint_series(kept.joints, "turn", item), link_series(kept.joints, "b")
    pages = [page_of(kept, Span(), most) for most in (16, 17, 256, 257)]
    assert [_is_short(page, turning) for page in pages] == [True, True, True, False]
    assert [_is_short(page, posed) for page in pages] == [True, False, False, False]
