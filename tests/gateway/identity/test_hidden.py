"""Resources that a caller may not read appear nowhere: not in listings, links, streams or errors."""

import json
from collections.abc import Iterator

import httpx
import pytest
from rdflib import URIRef

from authenticated_gateway import HIDDEN, SEEN, AuthenticatedGateway
from browser import HYBRIT, LDP, LF, MATHS, VOM, Browser, links
from running import eventually, process
from small_fleet import live, offline
from subscribers import Socket, refused
from walk import walk

pytestmark = pytest.mark.virtual
_TURTLE = {"content-type": "text/turtle"}
_PREFIXES = f"@prefix hybrit: <{HYBRIT}> . @prefix lf: <{LF}> .\n"


@pytest.fixture(scope="module")
def lab(here: AuthenticatedGateway) -> Iterator[Browser]:
    """All rights, but to one robot only."""
    with here.browsing("lab") as browser:
        yield browser


@pytest.fixture(scope="module")
def root(here: AuthenticatedGateway) -> Iterator[Browser]:
    with here.browsing("root") as browser:
        yield browser


def test_a_walk_of_everything_meets_no_hidden_robot(lab: Browser) -> None:
    found = walk(lab.root, lab.http)
    assert len(found.things()) > 10
    for page in found:
        assert HIDDEN not in page.response.text and HIDDEN not in str(page.response.headers), page.url


def test_the_fleet_lists_visible_robots(here: AuthenticatedGateway, lab: Browser, root: Browser) -> None:
    def listed(browser: Browser) -> set[str]:
        page = browser.page(browser.root)
        names = {str(each).removeprefix(browser.root) for each in page.graph.objects(page.iri, LDP.contains)}
        linked = {each.removeprefix(browser.root) for each in links(page.response, "related")}
        (context,) = json.loads(browser.http.get(browser.root + "linkset").content)["linkset"]
        linkset = {each["href"].removeprefix(browser.root) for each in context["related"]}
        assert names <= linked and names <= linkset
        return names

    assert listed(root) == {f"{SEEN}/", f"{HIDDEN}/"}
    assert listed(lab) == {f"{SEEN}/"}


def _told(answer: httpx.Response, path: str) -> tuple[object, ...]:
    """Return everything but what must differ."""
    headers = {
        name: value for name, value in answer.headers.items() if name not in ("x-request-id", "date", "content-length")
    }
    return answer.status_code, headers, answer.text.replace(path, "")


@pytest.mark.parametrize("method", ["GET", "HEAD", "OPTIONS", "POST", "PUT", "DELETE", "PATCH"])
@pytest.mark.parametrize(
    "rest",
    ["", "/", "/wrist_3_joint", "/actions/stop", "/subscriptions", "/lease", "/title", "/linkset", "/cameras", "/x/"],
)
def test_a_hidden_robot_is_like_none(lab: Browser, method: str, rest: str) -> None:
    told = [
        _told(lab.http.request(method, lab.root + name + rest, headers=_TURTLE), f"{name}{rest}")
        for name in (HIDDEN, "none-1")
    ]
    assert told[0] == told[1] and told[0][0] == 404


@pytest.mark.parametrize("headers", [{"accept": "text/event-stream"}, {"accept": "text/html"}, {"accept": "x/y"}])
def test_however_one_asks(lab: Browser, headers: dict[str, str]) -> None:
    told = [_told(lab.http.get(lab.root + name + "/", headers=headers), name) for name in (HIDDEN, "none-1")]
    assert told[0] == told[1] and told[0][0] == 404


def test_a_websocket_to_a_hidden_robot_is_refused_like_one_to_none(here: AuthenticatedGateway) -> None:
    bearer = f"Bearer {here.tokens['lab']}"
    answers = [refused(f"{here.root}{name}/", Authorization=bearer) for name in (HIDDEN, "none-1")]
    assert [each.status_code for each in answers] == [404, 404]
    bodies = [
        (each.body or b"").decode().replace(name, "") for each, name in zip(answers, (HIDDEN, "none-1"), strict=True)
    ]
    assert bodies[0] == bodies[1]


def test_nothing_hidden_can_be_subscribed_to(lab: Browser) -> None:
    told = []
    for name in (HIDDEN, "none-1"):
        body = _PREFIXES + f"[] a hybrit:Subscription ; hybrit:onResource <{lab.root}{name}/> ."
        answer = lab.http.post(lab.root + "subscriptions", content=body, headers=_TURTLE)
        told.append(_told(answer, name))
    assert told[0] == told[1] and told[0][0] == 422


def test_a_subtree_covers_visible_robots_also_new_ones(here: AuthenticatedGateway, root: Browser) -> None:
    """A robot of each kind comes later: one is reported, the other is not."""
    url = here.root + "?depth=subtree"
    with (
        Socket(url, Authorization=f"Bearer {here.tokens['lab-subscriber']}") as narrow,
        Socket(url, Authorization=f"Bearer {here.tokens['subscriber']}") as wide,
        process(
            "-m", "linked_fleet_agent", "--robot=hall-2=ur5", "--robot=lab-2=ur5", "--connect", here.place.zenoh
        ),
    ):  # fmt: skip
        live(root, "hall-2")
        live(root, "lab-2")
        assert any("/hall-2/wrist_3_joint" in wide.raw() for _ in range(20_000))
        told = ""
        while "/lab-2/wrist_3_joint" not in told:
            told = narrow.raw()
            assert "hall-" not in told
    offline(root, "hall-2")
    offline(root, "lab-2")


def test_stop_all_reaches_whom_one_may_stop_and_tells_of_those_alone(
    here: AuthenticatedGateway, lab: Browser, root: Browser
) -> None:
    stop_all = root.action(root.page(root.root), LF.StopAll)
    invocations = str(root.page(stop_all).one(LF.invocations))

    def stopped(browser: Browser, url: str) -> set[str]:
        page = browser.page(url)
        return {str(each).removeprefix(here.root) for each in page.graph.objects(None, LF.ofRobot)}

    def listed(browser: Browser) -> set[str]:
        page = browser.page(invocations)
        return {str(each) for each in page.graph.objects(page.iri, LDP.contains)}

    mine = lab.http.post(stop_all).headers["location"]
    whole = root.http.post(stop_all).headers["location"]
    assert stopped(root, mine) == {f"{SEEN}/"} and stopped(lab, mine) == {f"{SEEN}/"}
    assert {f"{SEEN}/", f"{HIDDEN}/"} <= stopped(root, whole)
    assert {mine, whole} <= listed(root)
    assert mine in listed(lab) and whole not in listed(lab)
    assert lab.http.get(whole).status_code == 404
    with here.browsing("button") as button:  # has only the right to stop
        answer = button.http.post(stop_all)
        assert answer.status_code == 204
        assert stopped(root, answer.headers["location"]) == {f"{SEEN}/"}
        assert button.http.get(here.root).status_code == 403


def test_ended_invocations_are_linked_only_if_visible(lab: Browser, root: Browser) -> None:
    """The invocation of stopAll, which includes a hidden robot, is not linked for callers that may not see it."""
    rotate = root.action(root.part(SEEN, "wrist_3_joint"), LF.Rotate)
    body = (
        "@prefix vom: <http://vocab.arvida.de/2015/06/vom/vocab#> . @prefix unit: <http://qudt.org/vocab/unit/> .\n"
        "<> vom:numericalValue -3.0 ; vom:unit unit:RAD ."
    )
    moving = root.http.post(rotate, content=body, headers=_TURTLE).headers["location"]
    stop = root.http.post(root.action(root.page(root.root), LF.StopAll)).headers["location"]

    def ended_by(browser: Browser) -> list[URIRef]:
        page = browser.page(moving)
        return [URIRef(str(each)) for each in page.graph.objects(page.iri, LF.preemptedBy)]

    ended = eventually(lambda: root.page(moving).one(LF.state) not in (LF.accepted, LF.running), "the motion ended")
    assert ended
    assert ended_by(root) in ([URIRef(stop)], [])
    assert ended_by(lab) == []


def test_invisible_robots_are_not_named_in_collisions(lab: Browser, root: Browser) -> None:
    """Nor its place, by poses or in the world."""
    prefixes = "".join(
        f"@prefix {name}: <{iri}> .\n"
        for name, iri in (("lf", LF), ("maths", MATHS), ("vom", VOM), ("unit", "http://qudt.org/vocab/unit/"))
    )
    for name, y in ((SEEN, 0), (HIDDEN, 0.45)):
        where = f"<> lf:position [ maths:x 0 ; maths:y {y} ; maths:z 0 ; vom:unit unit:M ] ."
        url = str(root.robot(name).one(LF.placement))
        assert root.http.put(url, content=prefixes + where, headers=_TURTLE).status_code == 204

    def refused(browser: Browser) -> httpx.Response | None:
        turn = browser.action(browser.part(SEEN, "shoulder_pan_joint"), LF.Rotate)
        body = prefixes + "[] vom:numericalValue 90 ; vom:unit unit:DEG ."
        answer = browser.http.post(turn, content=body, headers=_TURTLE)
        assert answer.status_code in (409, 503), answer.text
        assert browser is root or HIDDEN not in answer.text
        return answer if answer.status_code == 409 else None

    assert HIDDEN in eventually(lambda: refused(root), "a refusal").text
    assert len(eventually(lambda: refused(lab), "a refusal").json()["things"]) == 1
    invocations = root.page(root.action(root.part(SEEN, "shoulder_pan_joint"), LF.Rotate)).one(LF.invocations)
    assert HIDDEN not in lab.page(str(invocations)).response.text
    world = root.page(str(root.page(root.root).one(LF.world)))
    assert HIDDEN in world.response.text and HIDDEN not in lab.page(world.url).response.text
    poses = str(world.one(LF.poses))
    asked = {"of": root.robot(HIDDEN).url}
    assert (root.http.get(poses, params=asked).status_code, lab.http.get(poses, params=asked).status_code) == (200, 404)
    for name in (SEEN, HIDDEN):
        assert root.http.delete(str(root.robot(name).one(LF.placement))).status_code == 204


def test_the_version_of_the_fleet_depends_on_the_view(here: AuthenticatedGateway, lab: Browser, root: Browser) -> None:
    def etag(browser: Browser) -> str:
        return str(browser.http.get(browser.root).headers["etag"])

    assert etag(lab) != etag(root)
    with process("-m", "linked_fleet_agent", "--robot=hall-3=ur5", "--connect", here.place.zenoh):
        before = etag(lab)
        live(root, "hall-3")
        assert etag(lab) == before


def test_queries_find_no_hidden_robot(lab: Browser, root: Browser) -> None:
    def ask(browser: Browser, query: str) -> bytes:
        return browser.http.get(f"{browser.root}query", params={"query": query}).raise_for_status().content

    named = f"ASK {{ ?s ?p ?o FILTER(CONTAINS(CONCAT(STR(?s), STR(?o)), '{HIDDEN}')) }}"
    assert (json.loads(ask(lab, named))["boolean"], json.loads(ask(root, named))["boolean"]) == (False, True)
    for query in ("SELECT * {{ GRAPH <{}/> {{ ?s ?p ?o }} }}", "SELECT * FROM <{}/> {{ ?s ?p ?o }}"):
        assert ask(lab, query.format(HIDDEN)) == ask(lab, query.format("nobody"))
        assert ask(lab, query.format(SEEN)) != ask(lab, query.format("nobody"))
    assert HIDDEN not in lab.page(f"{lab.root}query").response.text
