"""Single scripts of the pages in a browser: RDF read and written, numbers formatted like the gateway's."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import rdflib
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from playwright.sync_api import Page, Route

from linked_fleet_gateway.extensions.pages import texts
from properties import examples

pytestmark = [pytest.mark.processes, pytest.mark.test_all]
SOURCES = Path(__file__).parents[1] / "scripts" / "src"
HOME = "http://face.test/"
SLOWLY = settings(max_examples=examples(40), suppress_health_check=[HealthCheck.function_scoped_fixture])


@pytest.fixture
def module(page: Page) -> Iterator[Page]:
    """Yield a page on which the sources can be imported."""

    def serve(route: Route) -> None:
        name = route.request.url.removeprefix(HOME)
        if name:
            route.fulfill(content_type="text/javascript", path=SOURCES / name)
        else:
            route.fulfill(content_type="text/html", body="<!DOCTYPE html><title>modules</title>")

    page.route(HOME + "**", serve)
    page.goto(HOME)
    yield page


def _parsed(module: Page, text: str) -> list[list[Any]]:
    found: list[list[Any]] = module.evaluate(
        """async (text) => {
            const { parse } = await import("/ntriples.js");
            return [...parse(text).subjects].flatMap(([subject, facts]) =>
                [...facts].flatMap(([predicate, objects]) => objects.map((each) => [subject, predicate, each])));
        }""",
        text,
    )
    return found


@SLOWLY
@given(text=st.text(max_size=40))
def test_any_text_survives_n_triples(module: Page, text: str) -> None:
    """The output of another library is parsed, and the script's output is parsed by that library."""
    if any(0xD800 <= ord(each) <= 0xDFFF for each in text):
        return
    graph = rdflib.Graph()
    graph.add((rdflib.URIRef("http://a/s"), rdflib.URIRef("http://a/p"), rdflib.Literal(text)))
    ((_, _, found),) = _parsed(module, graph.serialize(format="nt"))
    assert found["value"] == text
    written = module.evaluate('async (value) => (await import("/ntriples.js")).write({ kind: "literal", value })', text)
    (back,) = rdflib.Graph().parse(data=f"<http://a/s> <http://a/p> {written} .", format="turtle").objects()
    assert str(back) == text


def test_terms_of_n_triples_are_told_apart(module: Page) -> None:
    said = (
        "_:b1 <http://p> _:b2 .\n\n# a comment\n"
        '<http://s> <http://p> "1.5"^^<http://t> .\n<http://s> <http://q> "x"@de-AT .'
    )
    words = "http://www.w3.org/1999/02/22-rdf-syntax-ns#langString"
    assert _parsed(module, said) == [
        ["_:b1", "http://p", {"kind": "blank", "value": "b2"}],
        ["http://s", "http://p", {"kind": "literal", "value": "1.5", "datatype": "http://t", "language": None}],
        ["http://s", "http://q", {"kind": "literal", "value": "x", "datatype": words, "language": "de-AT"}],
    ]


def test_invalid_n_triples_are_refused(module: Page) -> None:
    refused = module.evaluate(
        """async () => {
            const { parse } = await import("/ntriples.js");
            try { parse("<http://s> <http://p> .") } catch (error) { return error.name }
        }"""
    )
    assert refused == "SyntaxError"


@SLOWLY
@given(value=st.floats(-1e9, 1e9))
def test_numbers_are_written_as_the_gateway_does(module: Page, value: float) -> None:
    written = module.evaluate('async (value) => (await import("/format.js")).number(value)', value)
    # Halves are rounded to even on one side, and away from zero on the other.
    close = {texts.number(value), texts.number(value * (1 + 1e-9)), texts.number(value * (1 - 1e-9))}
    assert written in close
    for unit in ("rad", "m", "kg"):
        also = module.evaluate(
            'async ([value, unit]) => (await import("/format.js")).converted(value, unit)', [value, unit]
        )
        assert also in {texts.converted(value * factor, unit) for factor in (1, 1 + 1e-9, 1 - 1e-9)}


def test_nodes_that_share_nodes_are_read_once(module: Page) -> None:
    """Thirty nodes, each named three times by the one before: following every path would never end."""
    steps = [f"_:b{i} <http://{p}> _:b{i + 1} ." for i in range(30) for p in "pqr"]
    said = "\n".join(["<http://s> <http://p> _:b0 .", *steps, '_:b30 <http://p> "VALUE" .'])
    same = module.evaluate(
        """async (texts) => {
            const [{ parse }, { rest }] = await Promise.all([import("/ntriples.js"), import("/shown.js")]);
            return texts.map((text) => {
                const graph = parse(text);
                const { subjects } = graph;
                let left = 1000;
                graph.subjects = { keys: () => subjects.keys(), get: (subject) => {
                    if (!left--) throw new Error("the same nodes are read over and over");
                    return subjects.get(subject);
                } };
                return rest(graph, new Set());
            });
        }""",
        [said.replace("VALUE", "1"), said.replace("VALUE", "2"), said.replace("VALUE", "1").replace("_:b", "_:c")],
    )
    assert same[0] == same[2] != same[1]


@pytest.mark.parametrize(
    ("sent_s", "received_s", "dated_s", "text"),
    [
        (0, 0.1, 0, "5.0 s ago"),
        (-6, 0, -6, "5.0 s ago"),  # a response that took six seconds
        (-6, 0, -1, "5.0 s ago"),
        (0, 0, -60, "in 54 s"),  # the gateway's clock is a minute late, and the value newer than its response
        (0, 0, 60, "1 min ago"),
    ],
)
def test_a_slow_answer_is_no_clock_that_differs(
    module: Page, sent_s: float, received_s: float, dated_s: float, text: str
) -> None:
    """The gateway's clock is used only if its Date cannot lie between request and response."""
    shown = module.evaluate(
        """async ([sent, received, dated]) => {
            const age = { ...(await import("/age.js")), ...(await import("/gateway_clock.js")) };
            const now = Date.parse("2026-11-22T12:00:00Z");
            Date.now = () => now + received * 1000;
            const date = new Date(now + dated * 1000).toUTCString();
            age.agree({ headers: new Headers({ date }) }, now + sent * 1000);
            Date.now = () => now;
            const time = document.createElement("time");
            time.dateTime = new Date(now - 5000).toISOString();
            age.refresh(time);
            return time.textContent;
        }""",
        [sent_s, received_s, dated_s],
    )
    assert shown == text


def test_a_processor_does_not_draw_in_a_frame_that_began_too_early(module: Page) -> None:
    """A timer runs within a frame whose time, its begin, is before that of the timer."""
    drawn = module.evaluate(
        """async () => {
            const { Pacing } = await import("/scene_pacing.js");
            const frames = [], timers = [], drawn = [];
            let clock = 0;
            performance.now = () => clock;
            window.requestAnimationFrame = (call) => frames.push(call);
            window.setTimeout = (call, wait) => timers.push(call);
            const renderer = { getExtension: () => null, getParameter: () => "SwiftShader" };
            const pacing = new Pacing(renderer, (now) => drawn.push(now));
            const frame = (now) => frames.splice(0).forEach((call) => call(now));
            pacing.request();
            frame(0);
            frame(1); // how long drawing took
            pacing.request();
            clock = 67;
            timers.splice(0).forEach((call) => call());
            frame(50);
            frame(67);
            return drawn;
        }"""
    )
    assert drawn == [0, 67]


def test_a_history_replaces_what_it_covers_and_breaks_where_the_robot_was_away(module: Page) -> None:
    """Live points before and after it stay. Samples of a large fleet, further apart with age, are no absence."""
    places, table = module.evaluate(
        """async () => {
            const { covered, broken } = await import("/past.js");
            const pairs = [[[1, 2, 3, 4], [2, 3]], [[1, 2], []], [[], [1]], [[5], [1, 2]]];
            const places = pairs.map((each) => covered(...each));
            const times = [0, 100, 150, 175, 187, 190.1, 190.2, 199.9, 200];
            return [places, broken({ names: ["x"], times, columns: [times.map((_, index) => index)] })];
        }"""
    )
    assert places == [[1, 3], [2, 2], [0, 0], [0, 0]]
    assert table["times"] == [0, 100, 150, 175, 187, 190.1, 190.2, 190.2, 199.9, 200]
    assert table["columns"] == [[0, 1, 2, 3, 4, 5, 6, None, 7, 8]]
