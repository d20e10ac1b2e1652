"""Pages of a real fleet: every kind of resource has one, which shows what its triples say."""

from collections.abc import Iterator
from urllib.parse import urlsplit

import pytest
import rdflib
from pyoxigraph import BlankNode, Literal, NamedNode, Triple

from browser import DCTERMS, HYBRIT, LDP, LF, ROS, Browser
from dom import Element, parsed
from linked_fleet_gateway.extensions.things.td import TD
from linked_fleet_rdf.serialise import JELLY, parse
from linked_fleet_rdf.vocabulary import LF as OUR_TERMS

pytestmark = pytest.mark.virtual

KINDS = (
    "fleet",
    "robot",
    "joint",
    "link",
    "property",
    "annotations",
    "action",
    "invocation",
    "subscriptions",
    "lease",
    "document",
    "vocabulary",
    "invocations",
    "joint_state",
)


@pytest.fixture(scope="module")
def addresses(browser: Browser) -> dict[str, list[str]]:
    """Return the distinct pages of each kind."""
    root, robots = browser.page(browser.root), browser.robots()
    baxter, walker = browser.robot("baxter"), browser.robot("go2")
    turning, sliding = browser.part("baxter", "right_s1"), browser.part("panda", "panda_finger_joint1")
    link = browser.part("baxter", "head")
    properties = [
        *turning.graph.objects(turning.iri, HYBRIT.property),
        *walker.graph.objects(walker.iri, HYBRIT.property),
    ]
    properties += list(link.graph.objects(link.iri, HYBRIT.property))
    joint_state, annotations = walker.one(LF.jointState), walker.one(LF.annotations)
    actions = [*root.graph.objects(root.iri, HYBRIT.action), *baxter.graph.objects(baxter.iri, HYBRIT.action)]
    actions += list(turning.graph.objects(turning.iri, HYBRIT.action))
    held = browser.http.post(browser.action(turning, LF.Hold), headers={"prefer": "return=minimal"})
    assert held.is_success, held.text
    blueprints = [
        each for each in turning.graph.objects(turning.iri, HYBRIT.blueprint) if str(each).startswith(browser.root)
    ]
    return {
        "fleet": [browser.root],
        "robot": [each.url for each in robots],
        "joint": [turning.url, sliding.url],
        "link": [link.url],
        "property": [str(each) for each in properties if each not in (joint_state, annotations)],
        "annotations": [str(annotations)],
        "action": [str(each) for each in actions],
        "invocation": [held.headers["location"]],
        "subscriptions": [str(each.one(HYBRIT.subscriptions)) for each in (root, baxter, turning)],
        "lease": [str(baxter.one(LF.lease))],
        "document": [
            *map(str, blueprints),
        ],
        "vocabulary": [str(root.one(LF.vocabulary))],
        "invocations": [f"{each}/invocations" for each in actions[:1]],
        "joint_state": [str(baxter.one(LF.jointState))],
    }


def pages(browser: Browser, urls: list[str]) -> Iterator[tuple[str, Element]]:
    for url in urls:
        answer = browser.http.get(url, headers={"accept": "text/html"})
        assert answer.status_code == 200, f"{url}: {answer.text[:300]}"
        assert "script-src 'self'" in answer.headers["content-security-policy"]
        yield url, parsed(answer.content)


@pytest.mark.parametrize("kind", KINDS)
def test_every_kind_has_a_page_of_its_own(browser: Browser, addresses: dict[str, list[str]], kind: str) -> None:
    """One heading, landmarks, a link upwards, the other representations, nothing foreign, nothing inline."""
    for url, page in pages(browser, addresses[kind]):
        (body,) = page.all("body")
        assert (body["data-resource"], body["data-kind"], body["data-root"]) == (url, kind, browser.root)
        assert [each.tag for each in page.all("h1", "main", "header", "footer", "aside")] == [
            "header",
            "aside",
            "main",
            "h1",
            "footer",
        ]
        assert next(page.all("html"))["lang"] == "en"
        assert url == browser.root or [each for each in page.all("a", "link") if each.get("rel") == "up"]
        assert not [each for each in page.all() if "style" in each.attributes or each.tag == "style"]
        scripts = [each for each in page.all("script") if each.get("type") != "application/ld+json"]
        assert all(each.get("src").startswith("/assets/") and not each.text for each in scripts)
        loaded = [each["href"] for each in page.all("link") if each["rel"] in ("stylesheet", "icon")]
        drawings = [each["src"] for each in page.all("img")]
        assert not [each for each in (*loaded, *drawings) if urlsplit(each).netloc]
        assert not list(page.all("iframe", "object"))
        assert drawings == [f"{urlsplit(each).path}thumbnail" for each in addresses["robot"] if kind == "fleet"]
        ids = [each["id"] for each in page.with_attribute("id")]
        assert len(ids) == len(set(ids)), [each for each in ids if ids.count(each) > 1]
        # HTML does not allow "required" on a select with a preselected option.
        assert not [each for each in page.all("select") if "required" in each.attributes]
        (stop,) = [each for each in page.all("form") if each.get("class") == "stop"]
        assert OUR_TERMS.iri not in stop["data-action"] and stop["data-action"].startswith(browser.root)


def reached(triples: list[Triple], subject: str, path: str) -> list[object]:
    found: list[object] = [NamedNode(subject)]
    for hop in path.split(" "):
        if hop.startswith("^"):
            found = [t.subject for t in triples if t.object in found and t.predicate.value == hop[1:]]
        else:
            found = [t.object for t in triples if t.subject in found and t.predicate.value == hop]
    return found


@pytest.mark.parametrize("kind", ["fleet", "robot", "joint", "link", "property", "invocation"])
def test_live_values_are_where_they_say_they_are(browser: Browser, addresses: dict[str, list[str]], kind: str) -> None:
    """Subject and path lead to the displayed value in the triples embedded in the page."""
    seen = 0
    for url, page in pages(browser, addresses[kind]):
        data = next(each.text for each in page.all("script") if each.get("type") == "application/ld+json")
        triples = list(parse(data.encode(), "application/ld+json", url, max_triples=100_000, max_depth=100))
        for each in page.with_attribute("data-subject"):
            (term,) = [
                term
                for term in reached(triples, each["data-subject"], each["data-path"])
                if not isinstance(term, BlankNode)
            ]
            seen += 1
            if isinstance(term, Literal):
                assert each.get("value", each.get("datetime", term.value)) in (term.value, ""), url
                assert each.tag in ("data", "time", "meter", "progress", "figure")
            else:
                assert isinstance(term, NamedNode) and term.value.endswith(each.text or "")
    assert seen


def test_a_robot_shows_its_joints_with_their_values(browser: Browser) -> None:
    page = next(pages(browser, [browser.robot("baxter").url]))[1]
    parts = {each["data-part"]: each for each in page.with_attribute("data-part")}
    assert parts["right_s1"]["data-part-kind"] == "joint" and parts["head"]["data-part-kind"] == "link"
    row = next(each for each in page.by_id("joints").all("tr") if "right_s1" in each.text)
    assert [each["data-unit"] for each in row.all("data")] == ["rad", "rad/s", "N m"]
    scene = page.by_id("scene")
    assert scene["data-state"].endswith("/jointState") and scene["data-model"] == "/baxter/model"
    assert page.by_id("poses").text.split()[:2] == ["Named", "poses"] and "untucked" in page.by_id("poses").text


def test_a_joint_shows_where_it_is_between_its_limits(browser: Browser) -> None:
    joint = browser.part("baxter", "right_s1")
    page = next(pages(browser, [joint.url]))[1]
    (meter,) = page.all("meter")
    assert (float(meter["min"]), float(meter["max"])) == pytest.approx((-2.147, 1.047), abs=1e-3)
    ways = {each["rel"]: each["href"] for each in page.all("a") if each.get("rel") in ("prev", "next")}
    assert ways == {"prev": str(joint.one(ROS.preceedingLink)), "next": str(joint.one(ROS.succeedingLink))}
    (stop,) = [each for each in page.all("form") if each.get("class") == "stop"]
    assert stop["data-action"] == browser.action(browser.robot("baxter"), LF.StopRobot)


def test_the_fleet_lists_all_robots_and_stops_them_all(browser: Browser) -> None:
    page = next(pages(browser, [browser.root]))[1]
    shown = [each for each in page.by_id("robots").all("a")]
    root = browser.page(browser.root)
    assert {each["href"] for each in shown} == {str(each) for each in root.graph.objects(root.iri, LDP.contains)}
    assert {each.text for each in shown} == {
        str(root.graph.value(each, DCTERMS.title)) for each in root.graph.objects(root.iri, LDP.contains)
    }
    (stop,) = [each for each in page.all("form") if each.get("class") == "stop"]
    assert stop["data-action"] == browser.action(root, LF.StopAll)


def test_raw_representations_are_one_click_away(browser: Browser) -> None:
    """By a query, since a link cannot set Accept; an unknown word is answered with a list of known ones."""
    joint = browser.part("ur5", "elbow_joint")
    page = next(pages(browser, [joint.url]))[1]
    offered = [each for each in page.all("a") if "type" in each.attributes]
    assert len(offered) == 6
    for each in offered:
        answer = browser.http.get(each["href"], headers={"accept": "text/html"})
        assert answer.headers["content-type"].partition(";")[0] == each["type"]
        if each["type"] == JELLY:
            assert len(rdflib.Graph().parse(data=answer.content, format="jelly")) > 10
        elif each["type"] == TD:
            assert answer.json()["@type"]
        else:
            assert parse(answer.content, each["type"], joint.url)
    refused = browser.http.get(joint.url + "?as=pdf", headers={"accept": "text/html"})
    assert refused.status_code == 406 and "turtle" in refused.text
