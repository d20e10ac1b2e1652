"""Forms of the actions of five robots produce bodies that conform to their shapes."""

from collections.abc import Iterator
from urllib.parse import urljoin

import pyshacl
import pytest
import rdflib
from rdflib import RDF, URIRef

from browser import DCTERMS, HTTP, HYBRIT, LDP, LF, SH, Browser, Page
from dom import Element, filled, limits_of, needed, parsed

pytestmark = pytest.mark.virtual

ROBOTS = ("baxter", "ur5", "panda", "tiago", "go2")


def form_of(browser: Browser, url: str) -> Element:
    answer = browser.http.get(url, headers={"accept": "text/html"})
    assert answer.status_code == 200, answer.text[:500]
    (form,) = [each for each in parsed(answer.content).all("form") if each.get("class") == "invoke"]
    return form


def actions(browser: Browser, robot: str) -> Iterator[Page]:
    """Yield the actions of the robot, and of one joint of each of its kinds."""
    page = browser.robot(robot)
    kinds: set[object] = set()
    for thing in [page, *(browser.page(str(each)) for each in joints(page))]:
        for url in sorted(thing.graph.objects(thing.iri, HYBRIT.action)):
            action = browser.page(str(url))
            kind = next(each for each in action.types if each not in (HYBRIT.Action, HYBRIT.AsynchronousAction))
            if kind not in kinds:
                kinds.add(kind)
                yield action


def joints(robot: Page) -> list[URIRef]:
    """Return the first joint of each kind."""
    found = {}
    for part in sorted(robot.graph.subjects(RDF.type, LF.Joint)):
        found.setdefault(frozenset(robot.graph.objects(part, RDF.type)), part)
    return [URIRef(str(each)) for each in found.values()]


def conforms(body: rdflib.Graph, action: Page, shape: rdflib.term.Node) -> str:
    """Return the shape's violations at the root of the body; empty if it conforms."""
    (root,) = set(body.subjects()) - set(body.objects())
    about = rdflib.Graph()
    about += action.graph
    about.add((shape, SH.targetNode, URIRef("urn:root")))
    data = rdflib.Graph()
    for subject, predicate, value in body:
        data.add((URIRef("urn:root") if subject == root else subject, predicate, value))
    valid, _, text = pyshacl.validate(data, shacl_graph=about)
    return "" if valid else text


@pytest.mark.parametrize("robot", ROBOTS)
@pytest.mark.parametrize("everything", [False, True], ids=["needed", "everything"])
def test_bodies_conform_to_the_shape_of_their_action(browser: Browser, robot: str, everything: bool) -> None:
    """Filled in with the middle of each range, by the limits that the form states for the selected unit."""
    seen = 0
    for action in actions(browser, robot):
        form, shape = form_of(browser, action.url), action.graph.value(action.iri, HYBRIT.consumes)
        assert form["data-action"] == action.url
        methods = {str(each).rpartition("#")[2] for each in action.graph.objects(None, HTTP.mthd)}
        assert form["data-methods"].split() == sorted(methods, reverse=True)
        seen += 1
        if shape is None:
            assert not form.with_attribute("data-path")
            continue
        assert not conforms(filled(form, everything), action, shape), action.url
    assert seen > 4


def test_units_stand_once_with_degrees_first_and_limits_for_each(browser: Browser) -> None:
    """Degree and radian have three IRIs each."""
    joint = browser.part("ur5", "elbow_joint")
    form = form_of(browser, browser.action(joint, LF.Rotate))
    value, unit = [each for each in form.all("input", "select") if needed(each)][:2]
    options = [(each.text, each["value"]) for each in unit.all("option")]
    assert [text for text, _ in options] == ["°", "rad"]
    found = [limits_of(value, {unit["data-path"]: iri}) for _, iri in options]
    assert found == [{"min": -180.0, "max": 180.0}, {"min": -3.141592, "max": 3.141592}]


def test_joints_are_chosen_by_name_and_have_their_own_limits(browser: Browser) -> None:
    """A select of joints, beside a number whose limits depend on joint and unit."""
    form = form_of(browser, browser.action(browser.robot("baxter"), LF.MoveJoints))
    which = next(each for each in form.all("select") if each["data-path"] == str(LF.ofJoint))
    value = next(each for each in form.all("input") if "data-limits" in each.attributes)
    unit = next(each for each in form.all("select") if each["data-path"].endswith("unit"))
    options = {each.text: each["value"] for each in which.all("option")}
    degree = next(each["value"] for each in unit.all("option"))
    ends = {
        name: limits_of(value, {str(LF.ofJoint): options[name], unit["data-path"]: degree})
        for name in ("right_s1", "head_pan")
    }
    assert ends["right_s1"]["min"] == pytest.approx(-123, abs=0.1) and ends["right_s1"]["max"] == pytest.approx(
        60, abs=0.1
    )
    assert ends["head_pan"] != ends["right_s1"]


def test_repeatable_fields_can_be_added_and_removed(browser: Browser) -> None:
    """Waypoints, and targets in each of them."""
    form = form_of(browser, browser.action(browser.robot("ur5"), LF.FollowTrajectory))
    waypoints = next(each for each in form.all("div") if each.get("class") == "repeat")
    first, template = [each for each in waypoints.children if isinstance(each, Element)][:2]
    assert first.tag == "fieldset" and template.tag == "template" and first["data-path"] == str(LF.waypoint)
    assert [each["data-path"] for each in template.children if isinstance(each, Element)] == [first["data-path"]]
    assert any("data-add" in each.attributes for each in waypoints.all("button"))
    assert any("data-remove" in each.attributes for each in template.all("button"))
    assert [each["data-path"] for each in first.all("fieldset", inert=False)] == [str(LF.target)]


def test_every_field_has_a_label_and_every_id_is_one(browser: Browser) -> None:
    """For all forms of a robot, which may be on one page together."""
    ids: list[str] = []
    for action in actions(browser, "ur5"):
        form = form_of(browser, action.url)
        labelled = {each["for"] for each in form.all("label")}
        controls = [each for each in form.all("input", "select") if each.get("type") != "hidden"]
        assert {each["id"] for each in controls} == labelled, action.url
        own = [each["id"] for each in form.with_attribute("id")]
        described = [id for each in form.with_attribute("aria-describedby") for id in each["aria-describedby"].split()]
        assert set(described) <= set(own)
        ids += own
    assert len(ids) == len(set(ids)) > 50


def test_rehearsal_is_offered_where_the_action_can(browser: Browser) -> None:
    form = form_of(browser, browser.action(browser.part("ur5", "elbow_joint"), LF.Rotate))
    assert [each.get("data-prefer") for each in form.all("button") if each["type"] == "submit"] == ["dry-run", ""]


def test_a_callback_is_made_by_the_form_of_the_container(browser: Browser) -> None:
    """The form is about the thing that owns the container; its body is accepted unchanged."""
    robot = browser.robot("ur5")
    container = str(robot.one(HYBRIT.subscriptions))
    form = form_of(browser, container)
    assert form["data-action"] == container and form["data-methods"] == "POST"
    body = filled(form, everything=False)
    assert (None, HYBRIT.onResource, robot.iri) in body
    (root,) = set(body.subjects()) - set(body.objects())
    body.add((root, HYBRIT.callbackURL, rdflib.Literal("http://127.0.0.1:9/", datatype=rdflib.XSD.anyURI)))
    text = body.serialize(format="nt")
    made = browser.http.post(container, content=text, headers={"content-type": "text/turtle"})
    assert made.status_code == 201, made.text
    url = made.headers["location"]
    try:
        page = parsed(browser.http.get(container, headers={"accept": "text/html"}).content)
        assert url in [each["data-delete"] for each in page.with_attribute("data-delete")]
        assert "http://127.0.0.1:9/" in page.by_id("watches").text
    finally:
        assert browser.http.delete(url).status_code == 204
    assert URIRef(url) not in browser.page(container).graph.objects(None, LDP.contains)


@pytest.mark.parametrize("setting", [LF.TextProperty, LF.SpeedScale])
def test_settings_are_set_by_a_form_that_shows_what_is_set(browser: Browser, setting: URIRef) -> None:
    """The robot's page links the page of the setting, which has the form."""
    robot = browser.robot("ur5")
    url = str(robot.property(setting))
    page = parsed(browser.http.get(robot.url, headers={"accept": "text/html"}).content)
    assert url in [urljoin(robot.url, each["href"]) for each in page.with_attribute("href")]
    form = form_of(browser, url)
    assert form["data-action"] == url and form["data-methods"] == "PUT"
    (shown,) = [each["value"] for each in form.all("input") if each.get("type") != "hidden"]
    title = str(robot.graph.value(robot.iri, DCTERMS.title))
    assert shown == title if setting == LF.TextProperty else float(shown) > 0
    text = filled(form, everything=False).serialize(format="nt")
    assert browser.http.put(url, content=text, headers={"content-type": "text/turtle"}).status_code == 204
    after = browser.robot("ur5")
    assert str(after.graph.value(after.iri, DCTERMS.title)) == title
