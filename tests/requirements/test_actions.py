"""Figure 5: actions move the real simulated joint; invalid input moves nothing and says what would have been right."""

import math

import httpx
import pytest
import rdflib
from rdflib import URIRef

from browser import HYBRIT, LF, MATHS, PROV, SPATIAL, VOM, Browser
from commanding import ended
from simulated_robots import TURNTABLE

pytestmark = pytest.mark.virtual

ROBOTS = ("baxter", "panda", "ur5", f"turntable={TURNTABLE}")

_PREFIXES = """@prefix rdf: <http://www.w3.org/1999/02/22-rdf-syntax-ns#> .
@prefix xsd: <http://www.w3.org/2001/XMLSchema#> .
@prefix maths: <http://vocab.arvida.de/2015/06/maths/vocab#> .
@prefix unit: <http://qudt.org/vocab/unit/> .
@prefix vom: <http://vocab.arvida.de/2015/06/vom/vocab#> .
"""
_FIGURE_5B = _PREFIXES + '<> rdf:type maths:Scalar ; vom:numericalValue "43.6"^^xsd:float ; vom:unit vom:Degree .'
_TURTLE = {"content-type": "text/turtle"}


def _action(browser: Browser, robot: str, joint: str, kind: URIRef = LF.Rotate) -> str:
    return browser.action(browser.part(robot, joint), kind)


def _number(graph: rdflib.Graph, subject: object, predicate: URIRef) -> float:
    node = graph.value(subject, predicate)
    return float(graph.value(node, VOM.numericalValue))


def _angle(browser: Browser, robot: str, joint: str) -> float:
    page = browser.page(str(browser.part(robot, joint).one(URIRef("http://ros.org/#rotation"))))
    return _number(page.graph, page.iri, SPATIAL.rotationAngle)


def _put(browser: Browser, url: str, body: str, **headers: str) -> httpx.Response:
    return browser.http.put(url, content=body, headers=_TURTLE | headers)


def test_figure_5b_turns_the_joint(browser: Browser) -> None:
    """POST of Figure 5b: 204 with Location; the joint reaches 43.6°, never faster than its URDF limit."""
    joint = browser.part("baxter", "right_s1")
    velocity = str(joint.one(LF.velocity))
    limits = browser.page(str(joint.one(LF.limits)))
    allowed = _number(limits.graph, limits.iri, LF.velocityLimit)
    answer = browser.http.post(_action(browser, "baxter", "right_s1"), content=_FIGURE_5B, headers=_TURTLE)
    assert answer.status_code == 204, answer.text
    assert answer.content == b""
    speeds = []
    while browser.page(answer.headers["location"]).one(LF.state) in (LF.accepted, LF.running):
        page = browser.page(velocity)
        speeds.append(abs(_number(page.graph, page.iri, LF.value)))
    invocation = browser.page(answer.headers["location"])
    assert invocation.one(LF.state) == LF.succeeded, invocation.response.text
    assert (invocation.iri, PROV.endedAtTime, None) in invocation.graph
    assert math.degrees(_angle(browser, "baxter", "right_s1")) == pytest.approx(43.6, abs=0.5)
    assert 0.05 < max(speeds) <= allowed + 1e-6


def test_put_is_bound_as_well_and_radians_are_understood(browser: Browser) -> None:
    """PUT with a QUDT radian: the same motion by the other binding."""
    url = _action(browser, "ur5", "wrist_3_joint")
    answer = _put(browser, url, _PREFIXES + "<> vom:numericalValue 0.4 ; vom:unit unit:RAD .")
    assert answer.status_code == 204, answer.text
    assert ended(browser, answer.headers["location"]).one(LF.state) == LF.succeeded
    assert _angle(browser, "ur5", "wrist_3_joint") == pytest.approx(0.4, abs=0.01)


def test_prismatic_joint_translates_in_millimetres(browser: Browser) -> None:
    """Panda's finger has translate, in metre or millimetre; the finger that mimics it follows."""
    url = _action(browser, "panda", "panda_finger_joint1", LF.Translate)
    answer = _put(browser, url, _PREFIXES + "<> vom:numericalValue 30 ; vom:unit unit:MilliM .", prefer="wait=30")
    assert answer.status_code == 204, answer.text
    assert answer.headers["preference-applied"] == "wait=30"
    for name in ("panda_finger_joint1", "panda_finger_joint2"):
        page = browser.page(str(browser.part("panda", name).one(LF.translation)))
        assert _number(page.graph, page.iri, LF.displacement) == pytest.approx(0.03, abs=0.002)


def test_continuous_joint_takes_a_whole_turn_of_angles(browser: Browser) -> None:
    """350° is admitted (no limits) and reached the short way; 360° is not."""
    url = _action(browser, "turntable", "turn")
    body = _PREFIXES + "<> vom:numericalValue 350 ; vom:unit maths:Degree ."
    answer = _put(browser, url, body, prefer="wait=30")
    assert answer.status_code == 204, answer.text
    assert ended(browser, answer.headers["location"]).one(LF.state) == LF.succeeded
    assert math.degrees(_angle(browser, "turntable", "turn")) == pytest.approx(-10, abs=1)
    assert _put(browser, url, body.replace("350", "360")).status_code == 422


def test_json_ld_body(browser: Browser) -> None:
    """JSON-LD, in which 12.5 is a double, works like Turtle, with the context of the gateway."""
    url = _action(browser, "ur5", "wrist_2_joint")
    body = {
        "@context": "https://w3id.org/linked-fleet/context",
        "@id": "",
        "vom:numericalValue": 12.5,
        "vom:unit": {"@id": "vom:Degree"},
    }
    answer = browser.http.post(url, json=body, headers={"content-type": "application/ld+json", "prefer": "wait=30"})
    assert answer.status_code == 204, answer.text
    assert math.degrees(_angle(browser, "ur5", "wrist_2_joint")) == pytest.approx(12.5, abs=0.5)


def test_preferences(browser: Browser) -> None:
    """RFC 7240: representation → 201 with the invocation; respond-async → 202; a wait that elapses → 202."""
    url = _action(browser, "ur5", "wrist_1_joint")
    body = _PREFIXES + "<> vom:numericalValue {} ; vom:unit maths:Degree ."
    shown = _put(browser, url, body.format(5), prefer="return=representation")
    assert shown.status_code == 201
    graph = rdflib.Graph().parse(data=shown.text, format="turtle")
    assert (URIRef(shown.headers["location"]), LF.state, None) in graph
    later = _put(browser, url, body.format(90), prefer="respond-async")
    assert (later.status_code, later.headers["preference-applied"]) == (202, "respond-async")
    assert _put(browser, url, body.format(-90), prefer="wait=0").status_code == 202


def test_new_motion_preempts_the_old(browser: Browser) -> None:
    """A second motion of the same joint ends the first as preempted."""
    url = _action(browser, "baxter", "left_s0")
    body = _PREFIXES + "<> vom:numericalValue {} ; vom:unit maths:Degree ."
    first = _put(browser, url, body.format(60))
    second = _put(browser, url, body.format(-20), prefer="wait=30")
    assert ended(browser, first.headers["location"]).one(LF.state) == LF.preempted
    assert ended(browser, second.headers["location"]).one(LF.state) == LF.succeeded
    members = browser.page(str(browser.page(url).one(LF.invocations))).response.text
    assert all(each.headers["location"].rpartition("/")[2] in members for each in (first, second))


def test_invocation_conforms_to_what_the_action_produces(browser: Browser) -> None:
    """hybrit:produces is the shape of the invocation resource."""
    import pyshacl

    url = _action(browser, "baxter", "left_w2")
    answer = _put(browser, url, _PREFIXES + "<> vom:numericalValue 5 ; vom:unit maths:Degree .", prefer="wait=30")
    shapes = browser.page(str(browser.page(url).one(HYBRIT.produces))).graph
    conforms, _, text = pyshacl.validate(browser.page(answer.headers["location"]).graph, shacl_graph=shapes)
    assert conforms, text


def test_if_match_takes_the_tag_of_any_representation(browser: Browser) -> None:
    """A stale If-Match is 412 and moves nothing; the current ETag of the JSON-LD is valid for a Turtle body."""
    url = _action(browser, "baxter", "left_w1")
    body = _PREFIXES + "<> vom:numericalValue 1 ; vom:unit maths:Degree ."
    assert _put(browser, url, body, **{"if-match": '"stale"'}).status_code == 412
    tag = browser.http.get(url, headers={"accept": "application/ld+json"}).headers["etag"]
    assert _put(browser, url, body, **{"if-match": tag}).status_code == 204


def test_other_bad_bodies(browser: Browser) -> None:
    """Empty, unparsable, unsupported, oversize, missing parts: each gets a specific response."""
    url = _action(browser, "baxter", "right_s1")
    assert _put(browser, url, "").status_code == 422
    assert _put(browser, url, _PREFIXES + "<> vom:unit vom:Degree .").status_code == 422
    assert _put(browser, url, _PREFIXES + "<> vom:numericalValue 1 .").status_code == 422
    broken = _put(browser, url, "<> <a> .\n")
    assert (broken.status_code, broken.json()["line"]) == (400, 1)
    assert _put(browser, url, "# " + "x" * 262_144).status_code == 413
    unsupported = browser.http.put(
        url, content="value=1", headers={"content-type": "application/x-www-form-urlencoded"}
    )
    assert (unsupported.status_code, "text/turtle" in unsupported.text) == (415, True)
    two_roots = "[] vom:numericalValue 1 ; vom:unit vom:Degree . [] vom:numericalValue 2 ; vom:unit vom:Degree ."
    assert _put(browser, url, _PREFIXES + two_roots).status_code == 422


def test_validation_report_as_rdf(browser: Browser) -> None:
    """With RDF in Accept, the problem carries the SHACL report down to the wrong value; Link names the constraint."""
    url = _action(browser, "baxter", "right_s1")
    body = _PREFIXES + "<> vom:numericalValue 500 ; vom:unit vom:Degree ."
    answer = _put(browser, url, body, accept="text/turtle")
    assert answer.status_code == 422
    graph = rdflib.Graph().parse(data=answer.text, format="turtle")
    (report,) = graph.subjects(rdflib.RDF.type, rdflib.SH.ValidationReport)
    (result,) = graph.objects(report, rdflib.SH.result)
    details = graph.transitive_objects(result, rdflib.SH.detail)
    assert VOM.numericalValue in {graph.value(detail, rdflib.SH.resultPath) for detail in details}
    assert "constrainedBy" in answer.headers["link"]


def test_paths_methods_and_types_that_are_not_there(browser: Browser) -> None:
    """404, 405 with Allow, 406 with the available types, 308 for another spelling."""
    root, get = browser.root, browser.http.get
    for path in (
        "nobody/",
        "baxter/nothing",
        "baxter/right_s1/nothing",
        "baxter/right_s1/actions/fly",
        "%00",
        "baxter//",
    ):
        assert get(root + path).status_code == 404, path
    assert get(root + "baxter").headers["location"] == root + "baxter/"
    refused = browser.http.delete(root)
    assert (refused.status_code, refused.headers["allow"]) == (405, "GET, HEAD, OPTIONS")
    unacceptable = get(root, headers={"accept": "image/png"})
    assert (unacceptable.status_code, "text/turtle" in unacceptable.text) == (406, True)
    assert MATHS.Radian in set(browser.part("baxter", "right_s1").graph.objects())
