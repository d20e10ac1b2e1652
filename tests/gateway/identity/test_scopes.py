"""Every right with every affordance, found by links."""

from collections.abc import Iterator
from dataclasses import dataclass

import httpx
import pytest
import rdflib
from rdflib import URIRef

from authenticated_gateway import SEEN, AuthenticatedGateway
from browser import HYBRIT, LDP, LF, Browser, links
from commanding import PREFIXES
from running import eventually
from small_fleet import live
from subscribers import PATIENCE_S, Socket, refused

pytestmark = pytest.mark.virtual

NAMES = ("reader", "subscriber", "stopper", "actor", "admin")
_JOINT = "wrist_3_joint"
_PREFIXES = f"@prefix lf: <{LF}> . @prefix hybrit: <{HYBRIT}> . @prefix unit: <http://qudt.org/vocab/unit/> .\n"
_ROTATE = (
    "@prefix vom: <http://vocab.arvida.de/2015/06/vom/vocab#> . @prefix unit: <http://qudt.org/vocab/unit/> .\n"
    "<> vom:numericalValue 0.1 ; vom:unit unit:RAD ."
)


@dataclass
class RightsCase:
    """A request, and the rights that permit it."""

    name: str
    allowed: tuple[str, ...]
    method: str
    url: str
    body: str = ""

    def do(self, http: httpx.Client) -> httpx.Response:
        headers = {"content-type": "text/turtle", "prefer": "respond-async"} if self.body else {}
        return http.request(self.method, self.url, content=self.body or None, headers=headers)


@pytest.fixture(scope="module")
def root(here: AuthenticatedGateway) -> Iterator[Browser]:
    with here.browsing("root") as browser:
        yield browser


def _deeds(browser: Browser) -> list[RightsCase]:
    robot, joint = live(browser, SEEN), browser.part(SEEN, _JOINT)
    fleet = browser.page(browser.root)

    def action(thing: object, kind: URIRef) -> str:
        return browser.action(thing, kind)  # type: ignore[arg-type]

    rotate, container = action(joint, LF.Rotate), str(joint.one(HYBRIT.subscriptions))
    stream = _PREFIXES + f"[] a hybrit:Subscription ; hybrit:onResource <{joint.url}> ."
    lease = _PREFIXES + '<> lf:holder "a" ; lf:leaseDuration 1.0 .'
    target = (
        "@prefix vom: <http://vocab.arvida.de/2015/06/vom/vocab#> . @prefix unit: <http://qudt.org/vocab/unit/> .\n"
        f"@prefix lf: <{LF}> . <> lf:value [ vom:numericalValue 0.1 ; vom:unit unit:RAD ] ."
    )
    origin = "lf:position [ maths:x 0 ; maths:y 0 ; maths:z 0 ; vom:unit unit:M ]"
    accepted = f"{PREFIXES}<> {origin} ; lf:acceptsUnchecked true ."
    title, scale = str(robot.property(LF.TextProperty)), str(robot.one(LF.maximumSpeedScale))
    act, stop, admin = ("actor",), ("stopper", "actor"), ("admin",)
    return [
        RightsCase("read the fleet", NAMES, "GET", browser.root),
        RightsCase("read a joint", NAMES, "HEAD", joint.url),
        RightsCase("ask for options", NAMES, "OPTIONS", rotate),
        RightsCase("rotate", act, "POST", rotate, _ROTATE),
        RightsCase("rotate by its target", act, "PUT", str(joint.one(LF.targetRotation)), target),
        RightsCase("hold", stop, "POST", action(joint, LF.Hold)),
        RightsCase("stop", stop, "POST", action(robot, LF.StopRobot)),
        RightsCase("stop all", stop, "POST", action(fleet, LF.StopAll)),
        RightsCase("take control", act, "PUT", str(robot.one(LF.lease)), lease),
        RightsCase("release control", act, "DELETE", str(robot.one(LF.lease))),
        RightsCase("rename", admin, "PUT", title, _PREFIXES + '<> lf:value "x" .'),
        RightsCase("accept unchecked links", admin, "PUT", str(robot.one(LF.placement)), accepted),
        RightsCase("slow down", admin, "PUT", scale, _PREFIXES + "<> lf:value 1.0 ."),
        RightsCase("subscribe", ("subscriber",), "POST", container, stream),
        RightsCase("subscribe to events", ("subscriber",), "GET", joint.url + "?events"),
    ]


def test_each_right_permits_its_own_requests_only(here: AuthenticatedGateway, root: Browser) -> None:
    for deed in _deeds(root):
        for name in NAMES:
            with here.browsing(name) as browser:
                if deed.url.endswith("?events"):
                    status, challenge = _events(browser.http, deed.url.removesuffix("?events"))
                else:
                    answer = deed.do(browser.http)
                    status, challenge = answer.status_code, answer.headers.get("www-authenticate", "")
            if name in deed.allowed:
                assert status not in (401, 403), f"{name} may {deed.name}: {status}"
            else:
                assert status == 403, f"{name} may not {deed.name}: {status}"
                assert 'error="insufficient_scope"' in challenge and "scope=" in challenge


def _events(http: httpx.Client, url: str) -> tuple[int, str]:
    with http.stream("GET", url, headers={"accept": "text/event-stream"}, timeout=PATIENCE_S) as response:
        return response.status_code, response.headers.get("www-authenticate", "")


def test_cancelling_needs_stop_and_deleting_needs_act(here: AuthenticatedGateway, root: Browser) -> None:
    rotate = root.action(root.part(SEEN, _JOINT), LF.Rotate)
    with here.browsing("actor") as actor, here.browsing("stopper") as stopper, here.browsing("reader") as reader:
        deed = RightsCase("rotate", (), "POST", rotate, _ROTATE.replace("0.1", "3.0"))
        # Another test may have had control of the robot for a second.
        invocation = eventually(lambda: deed.do(actor.http).headers.get("location"), "the motion begun")
        said = reader.page(invocation)
        agent = said.graph.value(said.iri, rdflib.PROV.wasAssociatedWith)
        # the requester, by name and without an address
        assert str(said.graph.value(agent, rdflib.DCTERMS.title)) == "actor"
        cancel = str(said.one(HYBRIT.action))
        assert reader.http.post(cancel).status_code == 403
        assert stopper.http.delete(invocation).status_code == 403
        assert stopper.http.post(cancel).status_code in (204, 409)
        assert actor.http.delete(invocation).status_code == 204


def test_only_who_has_the_right_of_a_person_takes_control_as_one(here: AuthenticatedGateway, root: Browser) -> None:
    """A program with the right to act cannot claim to be a person."""
    here.add("Ann", "read", "act", "person")
    lease = str(live(root, SEEN).one(LF.lease))

    def take(browser: Browser, priority: str) -> httpx.Response:
        said = f'{_PREFIXES}<> lf:holder "h" ; lf:leaseDuration 60 ; lf:priority "{priority}" .'
        return browser.http.put(lease, content=said, headers={"content-type": "text/turtle"})

    with here.browsing("actor") as program, here.browsing("Ann") as person:
        eventually(lambda: person.http.get(lease).status_code == 200, "the identity")
        eventually(lambda: take(program, "program").status_code == 204, "control")
        refused = take(program, "person")
        assert refused.status_code == 403
        assert 'scope="person"' in refused.headers["www-authenticate"]
        taken = take(person, "person")
        assert taken.status_code == 204
        assert take(program, "program").status_code == 409
        proof = {"lock-token": taken.headers["lock-token"]}
        assert person.http.delete(lease, headers=proof).status_code == 204


def test_websockets_need_the_right_to_subscribe(here: AuthenticatedGateway, root: Browser) -> None:
    url = root.part(SEEN, _JOINT).url
    assert refused(url).status_code == 401
    assert refused(url, Authorization=f"Bearer {here.tokens['reader']}").status_code == 403
    assert refused(url, Authorization="Bearer nonsense").status_code == 401
    with Socket(url, Authorization=f"Bearer {here.tokens['subscriber']}") as open_:
        assert _JOINT in open_.raw()


def test_callbacks_by_upgrade_need_the_right_to_subscribe(here: AuthenticatedGateway, root: Browser) -> None:
    url = root.part(SEEN, _JOINT).url
    headers = {"connection": "upgrade", "upgrade": "callback", "callback": "http://127.0.0.1:9/"}
    with here.browsing("reader") as reader:
        assert reader.http.get(url, headers=headers).status_code == 403
    with here.browsing("subscriber") as subscriber:
        answer = subscriber.http.get(url, headers=headers)
        assert answer.status_code == 201
        assert subscriber.http.delete(answer.headers["location"]).status_code == 204


def test_missing_or_malformed_credentials_get_a_challenge(here: AuthenticatedGateway, root: Browser) -> None:
    with here.browsing(None) as nobody:
        for path in ("", "no-such-robot", "hall-1/", "audit"):
            answer = nobody.http.get(here.root + path)
            assert answer.status_code == 401
            assert answer.headers["www-authenticate"] == 'Bearer realm="linked-fleet"'
            assert answer.headers["content-type"].startswith("application/problem+json")
        for said in ("Bearer x", "Bearer", "Basic YTpi", f"Bearer {here.tokens['over']}", "Bearer a.b.c"):
            answer = nobody.http.get(here.root, headers={"authorization": said})
            assert answer.status_code == 401 and 'error="invalid_token"' in answer.headers["www-authenticate"], said
        for path in ("vocabulary", "context", "health/live", "login"):
            assert nobody.http.get(here.root + path).status_code == 200


def test_responses_are_private_to_the_caller(here: AuthenticatedGateway, root: Browser) -> None:
    answer = root.http.get(here.root)
    assert answer.headers["cache-control"] == "private, no-cache"
    assert answer.headers["vary"] == "Accept, Prefer, Accept-Encoding, Authorization, Cookie"
    mesh = next((each for each in links(root.http.get(root.robot(SEEN).url), "related") if "meshes" in each), None)
    assert mesh is None or "private" in root.http.head(mesh).headers["cache-control"]


@pytest.mark.parametrize(
    ("name", "status"), [(None, 401), ("reader", 403), ("lab", 403), ("scraper", 200), ("admin", 200)]
)
def test_metrics_need_administration_of_the_fleet(here: AuthenticatedGateway, name: str | None, status: int) -> None:
    with here.browsing(name) as browser:
        answer = browser.http.get(here.root + "metrics")
        assert answer.status_code == status
        assert ("linked_fleet_robots" in answer.text) == (status == 200)


def test_a_subscription_is_visible_to_its_creator_and_administrators(here: AuthenticatedGateway, root: Browser) -> None:
    joint = root.part(SEEN, _JOINT)
    container = str(joint.one(HYBRIT.subscriptions))
    body = _PREFIXES + f"[] a hybrit:Subscription ; hybrit:onResource <{joint.url}> ."

    def seen(name: str) -> set[str]:
        with here.browsing(name) as browser:
            page = browser.page(container)
            return {str(each) for each in page.graph.objects(page.iri, LDP.contains)}

    with here.browsing("subscriber") as subscriber, here.browsing("all") as other:
        made = subscriber.http.post(container, content=body, headers={"content-type": "text/turtle"})
        mine = made.headers["location"]
        assert mine in seen("subscriber") & seen("admin") & seen("lab") and mine not in seen("lab-subscriber")
        with here.browsing("lab-subscriber") as stranger:
            for answer in (stranger.http.get(mine), stranger.http.delete(mine), _slow_down(stranger, mine)):
                assert answer.status_code == 404
        assert {_slow_down(each, mine).status_code for each in (subscriber, other)} == {204}
        with other.http.stream("GET", mine, headers={"accept": "text/event-stream"}) as opened:
            assert opened.status_code == 409  # it is only for its creator
        assert other.http.delete(mine).status_code == 204
        assert mine not in seen("subscriber")


def test_administrators_cannot_extend_subscriptions_of_others_to_the_fleet(
    here: AuthenticatedGateway, root: Browser
) -> None:
    """Its messages contain what its creator may read, possibly more than the administrator may subscribe to."""
    body = _PREFIXES + f"[] a hybrit:Subscription ; hybrit:onResource <{root.root}> ; lf:depth lf:thisAlone ."
    headers = {"content-type": "text/turtle"}
    with here.browsing("subscriber") as subscriber, here.browsing("all") as other:
        made = subscriber.http.post(root.root + "subscriptions", content=body, headers=headers)
        assert made.status_code == 201, made.text
        update = "DELETE { <> lf:depth ?d } INSERT { <> lf:depth lf:wholeSubtree } WHERE { <> lf:depth ?d }"
        assert _patch(other, made.headers["location"], update).status_code == 403
        assert _patch(subscriber, made.headers["location"], update).status_code == 204
        assert subscriber.http.delete(made.headers["location"]).status_code == 204


def _slow_down(browser: Browser, subscription: str) -> httpx.Response:
    update = "DELETE { <> lf:deadband ?old } INSERT { <> lf:deadband 0.5 } WHERE { <> lf:deadband ?old }"
    return _patch(browser, subscription, update)


def _patch(browser: Browser, url: str, update: str) -> httpx.Response:
    headers = {"content-type": "application/sparql-update"}
    return browser.http.patch(url, content=f"PREFIX lf: <{LF}> {update}", headers=headers)


def test_readers_cannot_see_subscriptions(here: AuthenticatedGateway, root: Browser) -> None:
    """Containers of robots and of the fleet are 403 for each method of reading; a subscription seems not to exist.

    This also applies to the creator of a subscription that has lost the right to subscribe.
    """
    joint, fleet = root.part(SEEN, _JOINT), root.page(root.root)
    containers = [str(thing.one(HYBRIT.subscriptions)) for thing in (joint, fleet)]
    body = _PREFIXES + f"[] a hybrit:Subscription ; hybrit:onResource <{joint.url}> ."
    here.add("demoted", "read", "subscribe")
    here.known("demoted")
    with here.browsing("demoted") as demoted:
        mine = demoted.http.post(containers[0], content=body, headers={"content-type": "text/turtle"})
        location = mine.headers["location"]
        assert demoted.http.get(location).status_code == 200
        here.tables["demoted"] = here.tables["demoted"].replace('"read", "subscribe"', '"read"')
        here.write()
        assert eventually(lambda: demoted.http.get(location).status_code == 404, "the right to subscribe gone")
        for name in ("demoted", "reader", "stopper", "actor"):
            with here.browsing(name) as browser:
                assert browser.http.get(location).status_code == 404
                for method in ("GET", "HEAD", "OPTIONS"):
                    for container in containers:
                        answer = browser.http.request(method, container)
                        assert answer.status_code == 403, f"{name}: {method} {container}"
                        assert 'scope="subscribe"' in answer.headers["www-authenticate"]
    for name in ("subscriber", "admin"):
        with here.browsing(name) as browser:
            assert {browser.http.get(container).status_code for container in containers} == {200}


def test_pages_link_subscriptions_if_readable(here: AuthenticatedGateway, root: Browser) -> None:
    """No page leads its reader to a 403."""
    for thing in (root.page(root.root), root.robot(SEEN), root.part(SEEN, _JOINT)):
        link = f'href="{thing.one(HYBRIT.subscriptions)}"'
        for name in NAMES:
            with here.browsing(name) as browser:
                page = browser.http.get(thing.url, headers={"accept": "text/html"}).text
                assert "Blueprint</a>" in page
                assert (link in page) == (name in ("subscriber", "admin")), f"{name} at {thing.url}"
