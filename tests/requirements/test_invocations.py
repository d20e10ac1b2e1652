"""R0.7 and R0.8 of the paper on every action of every robot; each joint is sent to its present position."""

import math
from collections.abc import Callable

import pytest
import rdflib
from rdflib import URIRef
from rdflib.collection import Collection

from browser import HYBRIT, LF, MATHS, SH, VOM, Browser
from commanding import PREFIXES, TURTLE, ended
from walk import WALKED, Visited, Walk

pytestmark = pytest.mark.virtual
ROBOTS = WALKED

_HTTP = rdflib.Namespace("http://www.w3.org/2011/http#")
_ABSOLUTE = (LF.Rotate, LF.Translate)
_NO_BODY = (LF.Hold, LF.StopRobot, LF.StopAll)
_OTHERS = (LF.RotateBy, LF.TranslateBy, LF.MoveJoints, LF.FollowTrajectory, LF.Reach, LF.AssumePose)


def _kind(action: Visited, *kinds: URIRef) -> bool:
    return any((action.iri, rdflib.RDF.type, kind) in action.graph for kind in kinds)


def _bound(action: Visited, method: str) -> str | None:
    """Return the URL for this method, as bound in the description."""
    for request in action.graph.objects(action.iri, HYBRIT.binding):
        if str(action.graph.value(request, _HTTP.mthd)).endswith(f"#{method}"):
            return str(action.graph.value(request, _HTTP.requestURI))
    return None


def _stay(tree: Walk, browser: Browser, action: Visited) -> str:
    """Return a body without effect; for actions of a robot, with its first available joint."""
    if _kind(action, *_NO_BODY):
        return ""
    if _kind(action, *_ABSOLUTE):
        return PREFIXES + f"<> {_place(browser, action)} ."
    if _kind(action, LF.RotateBy, LF.TranslateBy):
        unit = "unit:RAD" if _kind(action, LF.RotateBy) else "unit:M"
        return PREFIXES + f"<> vom:numericalValue 0 ; vom:unit {unit} ."
    if _kind(action, LF.AssumePose):
        return PREFIXES + '<> lf:poseName "home" .'
    robot = str(action.graph.value(action.iri, rdflib.RDFS.seeAlso))
    if _kind(action, LF.Reach):
        return PREFIXES + _present_pose(browser, action.graph)
    joint = next(each for each in tree.of("action") if each.url.startswith(robot) and _kind(each, *_ABSOLUTE))
    target = (
        f"lf:target [ lf:ofJoint <{joint.graph.value(joint.iri, rdflib.RDFS.seeAlso)}> ; {_place(browser, joint)} ]"
    )
    return PREFIXES + (
        f"<> {target} ." if _kind(action, LF.MoveJoints) else f"<> lf:waypoint [ lf:atTime 1 ; {target} ] ."
    )


def _present_pose(browser: Browser, shape: rdflib.Graph) -> str:
    """Return the pose of the last link that the shape of ``reach`` names."""
    (links,) = [list(Collection(shape, shape.value(each, SH["in"]))) for each in shape.subjects(SH.path, LF.ofLink)]
    page = browser.page(str(browser.page(str(links[-1])).one(LF.pose)))
    position = page.graph.value(page.iri, LF.position)
    x, y, z = (page.graph.value(position, MATHS[axis]) for axis in "xyz")
    where = f"lf:position [ maths:x {x} ; maths:y {y} ; maths:z {z} ; vom:unit unit:M ]"
    return f'<> lf:ofLink <{links[-1]}> ; {where} ; lf:frame "{page.graph.value(page.iri, LF.frame)}" .'


def _invoke(tree: Walk, browser: Browser, action: Visited, method: str) -> str:
    """Return the invocation, which the response links."""
    url, body = _bound(action, method), _stay(tree, browser, action)
    assert url is not None
    answer = browser.http.request(method, url, content=body, headers=TURTLE if body else {})
    assert (answer.status_code, answer.content) == (204, b""), f"{url}: {answer.text}"
    return answer.headers["location"]


def _place(browser: Browser, action: Visited) -> str:
    """Return the present position in the unit of the shape's last branch (SI), within its limits, for a body."""
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
    return f"vom:numericalValue {clip(float(position), low, high)!r} ; vom:unit <{unit}>"


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


def _all_succeed(browser: Browser, urls: list[str]) -> None:
    states = {url: ended(browser, url).one(LF.state) for url in urls}
    assert set(states.values()) <= {LF.succeeded}, [url for url, state in states.items() if state != LF.succeeded]


@pytest.mark.parametrize("method", ["POST", "PUT"])
def test_r0_7_and_r0_8_every_joint_answers_204_with_location(tree: Walk, browser: Browser, method: str) -> None:
    """R0.7, R0.8: 204 without a body, and Location leads to the invocation, which ends well."""
    urls = [_invoke(tree, browser, each, method) for each in tree.of("action") if _kind(each, *_ABSOLUTE)]
    assert len(urls) == len(set(urls)) == 14
    _all_succeed(browser, urls)


@pytest.mark.parametrize("method", ["POST", "PUT"])
def test_r0_7_and_r0_8_of_other_resources(tree: Walk, browser: Browser, method: str) -> None:
    """One kind after another, at everything that offers it, because they would end each other."""
    done = set()
    for kind in (*_OTHERS, *_NO_BODY):
        actions = [each for each in tree.of("action") if _kind(each, kind) and _bound(each, method) is not None]
        _all_succeed(browser, [_invoke(tree, browser, each, method) for each in actions])
        done |= {kind} if actions else set()
    assert done == ({*_OTHERS, *_NO_BODY} if method == "POST" else {LF.MoveJoints, LF.Reach, LF.AssumePose})


def test_methods_without_a_binding_are_not_allowed(tree: Walk, browser: Browser) -> None:
    """405 with exactly the methods that the description binds."""
    for action in tree.of("action"):
        bound = {method for method in ("POST", "PUT") if _bound(action, method)}
        for method in {"POST", "PUT", "DELETE"} - bound:
            answer = browser.http.request(method, action.url)
            assert answer.status_code == 405, action.url
            assert set(answer.headers["allow"].split(", ")) == {"GET", "HEAD", "OPTIONS", *bound}
