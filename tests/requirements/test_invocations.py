"""R0.7 and R0.8 of the paper on every action of every robot: each joint is asked to go where it is."""

import math
from collections.abc import Callable

import pytest
import rdflib
from browser import HYBRIT, LF, SH, VOM, Browser
from rdflib import URIRef
from rdflib.collection import Collection
from running import eventually
from walk import Visited, Walk

pytestmark = pytest.mark.fleet

_HTTP = rdflib.Namespace("http://www.w3.org/2011/http#")
_BODY = """@prefix vom: <http://vocab.arvida.de/2015/06/vom/vocab#> .
<> vom:numericalValue {value} ; vom:unit <{unit}> ."""


def _invoke_all(tree: Walk, browser: Browser, method: str) -> list[str]:
    """Locations of one invocation per action, by the binding of that method in its description."""
    found = []
    for action in tree.of("action"):
        bound = [
            request
            for request in action.graph.objects(action.iri, HYBRIT.binding)
            if str(action.graph.value(request, _HTTP.mthd)).endswith(f"#{method}")
        ]
        (url,) = [str(action.graph.value(request, _HTTP.requestURI)) for request in bound]
        body = _stay(tree, browser, action)
        answer = browser.http.request(method, url, content=body, headers={"content-type": "text/turtle"})
        assert (answer.status_code, answer.content) == (204, b""), f"{url}: {answer.text}"
        found.append(answer.headers["location"])
    return found


def _stay(tree: Walk, browser: Browser, action: Visited) -> str:
    """A body that asks for the present position, in the unit of the shape's last branch (SI), within its bounds."""
    unit, low, high, clip = _last_branch(action.graph)
    joint = str(action.graph.value(action.iri, rdflib.RDFS.seeAlso))
    graph = browser.page(joint).graph
    position = next(
        value
        for predicate in (URIRef("http://ros.org/#rotation"), LF.translation)
        for each in graph.objects(URIRef(joint), predicate)
        for scalar in graph.objects(each, None)
        for value in graph.objects(scalar, VOM.numericalValue)
    )
    return _BODY.format(value=repr(clip(float(position), low, high)), unit=unit)


def _last_branch(graph: rdflib.Graph) -> tuple[str, float, float, Callable[[float, float, float], float]]:
    (shape,) = graph.objects(None, HYBRIT.consumes)
    branch = list(Collection(graph, graph.value(shape, SH["or"])))[-1]
    which, limits = sorted(graph.objects(branch, SH.property), key=lambda node: (node, SH.minInclusive, None) in graph)
    low = float(graph.value(limits, SH.minInclusive))
    unit = str(list(Collection(graph, graph.value(which, SH["in"])))[-1])
    exclusive = graph.value(limits, SH.maxExclusive)
    if exclusive is not None:
        return unit, low, float(exclusive), lambda value, _low, _high: value % math.tau
    return unit, low, float(graph.value(limits, SH.maxInclusive)), lambda value, low, high: min(max(value, low), high)


@pytest.mark.parametrize("method", ["POST", "PUT"])
def test_r0_7_and_r0_8_every_action_answers_204_with_location(tree: Walk, browser: Browser, method: str) -> None:
    """R0.7, R0.8: 204 without a body, and Location leads to the invocation, which ends well."""
    locations = _invoke_all(tree, browser, method)
    assert len(locations) == len(set(locations)) > 80

    def ended(url: str) -> URIRef | None:
        state = browser.page(url).one(LF.state)
        return state if state not in (LF.accepted, LF.running) else None

    states = {url: eventually(lambda url=url: ended(url), f"the end of {url}") for url in locations}
    assert set(states.values()) == {LF.succeeded}, [url for url, state in states.items() if state != LF.succeeded]
