"""Paper 5.1: every representation conforms to its own blueprint, as both are served; less than that does not."""

from collections.abc import Iterator
from pathlib import Path

import pyshacl
import pytest
import rdflib

from browser import HYBRIT, LF, SH, VOM, Browser
from commanding import begun, control, post, put, slowly
from walk import WALKED, Visited, Walk, walk

pytestmark = pytest.mark.virtual
ROBOTS = WALKED
_SHAPES = Path(__file__).parents[2] / "shapes" / "linked_fleet_shapes"


def _blueprint(tree: Walk, page: Visited) -> rdflib.Graph:
    (url,) = [str(b) for b in page.graph.objects(page.iri, HYBRIT.blueprint) if str(b) in tree.pages]
    return tree.pages[url].graph


def _conforms(data: rdflib.Graph, shapes: rdflib.Graph) -> tuple[bool, str]:
    conforms, _, text = pyshacl.validate(data, shacl_graph=shapes, inference="none")
    return bool(conforms), text


def _targets(page: Visited, shapes: rdflib.Graph) -> set[object]:
    """Return the shapes that name the resource: an empty graph would conform to those that only name its class."""
    return set(shapes.subjects(SH.targetNode, page.iri))


_AT_REST = ("fleet", "robot", "joint", "link", "property")


@pytest.mark.parametrize("kind", _AT_REST)
def test_everything_conforms_to_its_own_blueprint(tree: Walk, kind: str) -> None:
    """Every resource is a target of its blueprint, and conforms."""
    # Constant resources are checked once per kind and shape; every joint and link is checked.
    for page in tree.of(kind):
        shapes = _blueprint(tree, page)
        assert _targets(page, shapes), f"{page.url} is no target of its own blueprint"
        conforms, text = _conforms(page.graph, shapes)
        assert conforms, f"{page.url}\n{text}"


def test_taking_a_required_triple_away_fails(tree: Walk) -> None:
    """For one resource per shape: each counted predicate of the focus node is really required."""
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
    """Also in nested nodes: a rotation without its number, its unit or its axis does not conform."""
    page = next(page for page in tree.of("property") if page.url.endswith("/wrist_1_joint/rotation"))
    shapes = _blueprint(tree, page)
    nested = [t for t in page.graph if isinstance(t[0], rdflib.BNode)]
    assert len(nested) >= 8
    for triple in nested:
        less = rdflib.Graph()
        less += page.graph
        less.remove(triple)
        assert not _conforms(less, shapes)[0], triple


@pytest.fixture(scope="module")
def moving(tree: Walk, browser: Browser) -> Iterator[Walk]:
    """Yield everything reachable while every robot moves and is under control."""
    leases = {}
    for robot in tree.of("robot"):
        lease = str(robot.graph.value(robot.iri, LF.lease))
        answer = put(browser, lease, control("the test", 600))
        leases[lease] = {"lock-token": answer.headers["lock-token"]}
        begun(put(browser, _slow(tree, robot), _away(browser, _slow(tree, robot)), **leases[lease]))
    try:
        yield walk(browser.root, browser.http, before=tree)
    finally:
        begun(post(browser, browser.action(browser.page(browser.root), LF.StopAll)))
        for lease, fields in leases.items():
            browser.http.delete(lease, headers=fields)


def _slow(tree: Walk, robot: Visited) -> str:
    """Return the action of the robot's first joint that rotates within limits."""
    offered = (each for each in tree.of("action") if each.url.startswith(robot.url))
    rotations = (each for each in offered if (each.iri, rdflib.RDF.type, LF.Rotate) in each.graph)
    return next(each.url for each in rotations if not _is_endless(tree, each))


def _is_endless(tree: Walk, action: Visited) -> bool:
    (joint,) = action.graph.objects(action.iri, rdflib.RDFS.seeAlso)
    return (joint, rdflib.RDF.type, LF.ContinuousJoint) in tree.pages[str(joint)].graph


def _away(browser: Browser, action: str) -> str:
    """Move to the middle of the limits, slowly enough to continue while everything is read."""
    page = browser.page(action)
    (joint,) = page.graph.objects(page.iri, rdflib.RDFS.seeAlso)
    limits = browser.page(str(browser.page(str(joint)).one(LF.limits)))
    low, high = (
        float(limits.graph.value(limits.graph.value(limits.iri, each), VOM.numericalValue))
        for each in (LF.lowerLimit, LF.upperLimit)
    )
    return slowly(round(low + 0.6 * (high - low), 3), speed=0.002)


def _as_at_rest(page: Visited, blueprint: Visited, tree: Walk) -> bool:
    """Return True if both are byte-identical to what has been checked already."""
    before = tree.pages.get(page.url)
    if before is None or before.kind not in _AT_REST:
        return False
    pairs = ((before, page), (tree.pages[blueprint.url], blueprint))
    return all(old.response.content == new.response.content for old, new in pairs)


def test_everything_conforms_while_robots_move(tree: Walk, moving: Walk) -> None:
    """Things, properties, invocations and leases: whatever links a blueprint conforms to it."""
    seen: set[object] = set()
    states: set[object] = set()
    for page in moving:
        links = [str(each) for each in page.graph.objects(page.iri, HYBRIT.blueprint)]
        for url in (each for each in links if each in moving.pages):
            seen |= set(page.graph.objects(page.iri, rdflib.RDF.type))
            states |= set(page.graph.objects(page.iri, LF.state))
            if _as_at_rest(page, moving.pages[url], tree):
                continue
            shapes = moving.pages[url].graph
            assert _targets(page, shapes), f"{page.url} is no target of its own blueprint"
            conforms, text = _conforms(page.graph, shapes)
            assert conforms, f"{page.url}\n{text}"
    assert {LF.Fleet, LF.Robot, LF.Joint, LF.Invocation, LF.ControlLease} <= seen
    assert {LF.running, LF.held} <= states


def test_a_subscription_conforms_to_its_own_blueprint(browser: Browser) -> None:
    """A robot's stream that waits for its client."""
    robot = browser.robot("ur5")
    body = f"<> a <{HYBRIT.Subscription}> ; <{HYBRIT.onResource}> <{robot.url}> ."
    answer = post(browser, str(robot.one(HYBRIT.subscriptions)), body)
    assert answer.status_code == 201, answer.text
    page = browser.page(answer.headers["location"])
    (url,) = [each for each in page.graph.objects(page.iri, HYBRIT.blueprint) if str(each).startswith(browser.root)]
    shapes = browser.page(str(url)).graph
    assert (None, SH.targetNode, page.iri) in shapes
    conforms, text = _conforms(page.graph, shapes)
    assert browser.http.delete(page.url).status_code == 204
    assert conforms, text


def test_every_action_conforms(moving: Walk) -> None:
    """Figure 5a: each action of fleet, robots, joints and invocations conforms to the blueprint of actions."""
    shapes = rdflib.Graph().parse(_SHAPES / "blueprints.ttl")
    kinds = set()
    for page in moving.of("action"):
        conforms, text = _conforms(page.graph, shapes)
        assert conforms, f"{page.url}\n{text}"
        kinds |= set(page.graph.objects(page.iri, rdflib.RDF.type))
    assert {LF.StopAll, LF.Reach, LF.Rotate, LF.Hold, LF.CancelInvocation} <= kinds


def _required(shapes: rdflib.Graph, targets: frozenset[object]) -> set[rdflib.URIRef]:
    found: set[rdflib.URIRef] = set()
    for shape in targets:
        for node in [shape, *shapes.objects(shape, SH.node)]:
            for each in shapes.objects(node, SH.property):
                count = shapes.value(each, SH.minCount)
                if count is not None and int(count) > 0:
                    found.add(shapes.value(each, SH.path))
    return found
