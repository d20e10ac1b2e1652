"""R1.8 and Figure 4 of the paper: the Subscriptions container of every Linked Robotic Thing."""

import json
from collections.abc import Iterator
from pathlib import Path

import httpx
import pytest
import rdflib
from rdflib import RDF, XSD, Literal, URIRef

from browser import DCTERMS, HYBRIT, LDP, LF, ROS, SH, Browser, links
from receivers import receiving
from running import eventually
from small_fleet import Place
from subscribers import (
    EVENTS,
    ObservedFleet,
    Socket,
    TwoJointRobot,
    emptied,
    events,
    graph_of,
    identifier,
    members,
    observed_fleet,
    refused,
)

pytestmark = pytest.mark.virtual

_TURTLE = {"content-type": "text/turtle"}
_GOLDEN = Path(__file__).parents[1] / "golden" / "figure_4.ttl"
_PREFIXES = f"@prefix hybrit: <{HYBRIT}> . @prefix lf: <{LF}> . @prefix xsd: <{XSD}> .\n"


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ObservedFleet]:
    with observed_fleet(Place(tmp_path_factory.mktemp("containers"))) as opened:
        yield opened


def _post(browser: Browser, container: str, body: str, **fields: str) -> httpx.Response:
    named = {name.replace("_", "-"): value for name, value in fields.items()}
    return browser.http.post(container, content=_PREFIXES + body, headers=_TURTLE | named)


def _stream(scene: ObservedFleet, toy: TwoJointRobot, more: str = "") -> str:
    """Return the URL at which a stream created by POST can be opened."""
    body = f"<> a hybrit:Subscription ; hybrit:onResource <{toy.rotation()}> {more} ."
    answer = _post(scene.browser, toy.subscriptions().url, body)
    assert answer.status_code == 201, answer.text
    return answer.headers["location"]


def test_r1_8_figure_4_can_be_posted_and_is_what_the_container_says(browser: Browser) -> None:
    """Figure 4 with real IRIs, posted to right_s1's container: all of its statements are served, under the new IRI."""
    joint = browser.part("baxter", "right_s1")
    container = str(joint.one(HYBRIT.subscriptions))
    with receiving() as receiver:
        text = _GOLDEN.read_text().replace("http://example.org/baxter/", browser.robot("baxter").url)
        text = text.replace("http://www.example.org/receiver", receiver.url("/receiver"))
        answer = browser.http.post(container, content=text, headers=_TURTLE)
        assert answer.status_code == 201, answer.text
        url = answer.headers["location"]
        try:
            (delivery, *_) = receiver.wait(1, "/receiver", "POST")
            assert (URIRef(str(joint.one(ROS.rotation))), RDF.type, HYBRIT.Property) in graph_of(
                delivery.body, "text/turtle", url
            )
            golden = rdflib.Graph().parse(data=text, format="turtle")
            (old,) = golden.subjects(RDF.type, HYBRIT.Subscription)
            page = browser.page(url)
            renamed = {old: URIRef(url), Literal(str(old).rpartition("/")[2]): Literal(identifier(page))}
            expected = {tuple(renamed.get(term, term) for term in triple) for triple in golden}
            assert expected <= set(browser.page(container).graph)
            about = {triple for triple in expected if triple[0] == URIRef(url)}
            assert about <= set(page.graph)
            assert about <= set(graph_of(answer.content, "text/turtle", url))
        finally:
            assert browser.http.delete(url).status_code == 204
    emptied(browser, container)


def test_r1_8_container_lists_every_kind_of_the_thing_and_its_properties(scene: ObservedFleet) -> None:
    """R1.8: an LDP container of the joint's own subscriptions and its properties', of all kinds, and of no other's."""
    with (
        scene.toy() as toy,
        receiving() as receiver,
        Socket(toy.part().url) as socket,
        events(toy.rotation()) as stream,
        Socket(toy.rotation("shoulder")) as other,
        Socket(toy.page.url) as robot,
        Socket(scene.root) as fleet,
    ):
        waiting = _stream(scene, toy)
        callback = scene.browser.http.get(
            toy.rotation(), headers={"upgrade": "callback", "connection": "upgrade", "callback": receiver.url()}
        ).headers["location"]
        kinds = {
            socket.description: {LF.WebSocketStream, LF.Stream},
            stream.description: {LF.EventStream, LF.Stream},
            waiting: {LF.Stream},
            callback: {HYBRIT.WebCallback},
        }
        page = toy.subscriptions()
        assert page.types == {LDP.BasicContainer, LDP.Container}
        assert members(page) == set(kinds)
        for url, types in kinds.items():
            one = scene.browser.page(url)
            assert one.types == {HYBRIT.Subscription, LDP.RDFSource} | types
            on = toy.part().url if url == socket.description else toy.rotation()
            assert one.one(HYBRIT.onResource) == URIRef(on)
            static = {(one.iri, p, one.graph.value(one.iri, p)) for p in (HYBRIT.onResource, DCTERMS.identifier)}
            assert static <= set(page.graph)
        for thing, expected in (
            (toy.part("shoulder"), other.description),
            (toy.page, robot.description),
            (scene.browser.page(scene.root), fleet.description),
        ):
            assert members(scene.browser.page(str(thing.one(HYBRIT.subscriptions)))) == {expected}
        assert not members(toy.subscriptions("tip"))
        for url in (waiting, callback):
            assert scene.browser.http.delete(url).status_code == 204
    emptied(scene.browser, page.url)
    emptied(scene.browser, scene.browser.page(scene.root).one(HYBRIT.subscriptions))


def test_r1_8_delete_ends_each_kind(scene: ObservedFleet) -> None:
    """R1.8: 204, then 404; a WebSocket closes with 1000, an event stream ends and EventSource stays away."""
    with scene.toy() as toy, Socket(toy.rotation()) as socket, events(toy.rotation()) as stream:
        socket.next(), stream.next()
        for url in (socket.description, stream.description, _stream(scene, toy)):
            allow = scene.browser.http.options(url).headers["allow"]
            assert set(allow.split(", ")) == {"GET", "HEAD", "OPTIONS", "PATCH", "DELETE"}
            assert scene.browser.http.delete(url, headers={"if-match": '"other"'}).status_code == 412
            assert scene.browser.http.get(url).status_code == 200
            assert scene.browser.http.delete(url).status_code == 204
            assert scene.browser.http.get(url).status_code == 404
            assert scene.browser.http.delete(url).status_code == 404
        assert socket.until_closed() == (1000, "the subscription was deleted")
        assert stream.ended()
        assert stream.last_event_id == "cancelled"
        for url in (toy.rotation(), stream.description):
            again = scene.browser.http.get(url, headers={"accept": EVENTS, "last-event-id": stream.last_event_id})
            assert (again.status_code, again.content) == (204, b"")
        assert not members(toy.subscriptions())


def test_r1_8_options_are_taken_and_shown(scene: ObservedFleet) -> None:
    """R1.8: media type, minimum interval, deadband and depth, by POST in Turtle and JSON-LD, and by the query."""
    with scene.toy() as toy:
        container, rotation = toy.subscriptions().url, toy.rotation()
        more = "; lf:depth lf:wholeSubtree ; lf:minimumInterval 0.25 ; lf:deadband 0.5"
        document = {
            "@context": {"hybrit": str(HYBRIT), "lf": str(LF)},
            "@type": "hybrit:Subscription",
            "hybrit:onResource": {"@id": rotation},
            "hybrit:mediaType": "application/ld+json",
            "lf:depth": {"@id": "lf:wholeSubtree"},
            "lf:minimumInterval": 0.25,
            "lf:deadband": 0.5,
        }
        json_ld = scene.browser.http.post(
            container, content=json.dumps(document), headers={"content-type": "application/ld+json"}
        )
        assert json_ld.status_code == 201, json_ld.text
        query = f"{rotation}?depth=subtree&interval=0.25&deadband=0.5"
        posted = _stream(scene, toy, more + ' ; hybrit:mediaType "application/ld+json"')
        with Socket(query, "application/ld+json") as socket:
            for url in (posted, json_ld.headers["location"], socket.description):
                page = scene.browser.page(url)
                values = {
                    predicate: page.graph.value(page.iri, predicate)
                    for predicate in (LF.depth, LF.minimumInterval, LF.deadband, HYBRIT.mediaType)
                }
                assert values[LF.depth] == LF.wholeSubtree
                assert (float(values[LF.minimumInterval]), float(values[LF.deadband])) == (0.25, 0.5)
                assert str(values[HYBRIT.mediaType]) == "application/ld+json"
        for url in (posted, json_ld.headers["location"]):
            assert scene.browser.http.delete(url).status_code == 204


def test_r1_8_posted_stream_is_opened_at_its_location(scene: ObservedFleet) -> None:
    """R1.8: by WebSocket and by EventSource, with the type that was posted; the description says what it is now."""
    with scene.toy() as toy:
        url = _stream(scene, toy, '; hybrit:mediaType "application/n-triples"')
        page = scene.browser.page(url)
        assert (page.one(LF.deliveryState), page.one(LF.lastDelivery)) == (LF.waiting, LF.unknown)
        with Socket(url, accept="text/turtle", subprotocol="lf.ntriples") as socket:
            first = socket.next("application/n-triples")
            assert (first.angle, first.iri) == (0.0, URIRef(toy.rotation()))
            assert socket.connection.subprotocol == "lf.ntriples"
            assert socket.description == url
            assert LF.WebSocketStream in scene.browser.page(url).types
            with events(url) as stream:  # the page was opened a second time
                assert socket.until_closed()[0] == 4409
                toy.pose(0.5)
                while stream.next("application/n-triples").angle != 0.5:
                    pass
                assert LF.EventStream in scene.browser.page(url).types

        def closed() -> bool:
            return scene.browser.page(url).one(LF.deliveryState) == LF.waiting

        eventually(closed, "a stream that waits to be opened again")
        with Socket(url) as again:
            assert again.next("application/n-triples").angle == 0.5
            assert scene.browser.http.delete(url).status_code == 204
            assert again.until_closed()[0] == 1000
        assert refused(url).status_code == 404


def test_r1_8_callbacks_are_not_opened(scene: ObservedFleet) -> None:
    """R1.8: the IRI of a callback subscription can be read and deleted; its messages only go to the receiver."""
    with scene.toy() as toy, receiving() as receiver:
        url = _stream(scene, toy, f'; hybrit:callbackURL "{receiver.url()}"')
        assert refused(url).status_code == 409
        assert scene.browser.http.get(url, headers={"accept": EVENTS}).status_code == 409
        assert scene.browser.http.delete(url).status_code == 204


def test_r1_8_wrong_container_is_422(scene: ObservedFleet) -> None:
    """R1.8: each thing's container takes its own; the problem names the right one."""
    with scene.toy() as toy:
        right, wrong = toy.subscriptions().url, toy.subscriptions("shoulder").url
        answer = _post(scene.browser, wrong, f"<> a hybrit:Subscription ; hybrit:onResource <{toy.rotation()}> .")
        assert answer.status_code == 422
        assert right in answer.json()["detail"]
        assert links(answer, str(LDP.constrainedBy)) == [wrong]
        assert not members(toy.subscriptions("shoulder"))
        assert not members(toy.subscriptions())


def test_r1_8_what_breaks_the_shape_is_422_with_the_report(scene: ObservedFleet) -> None:
    """R1.8: a body that fails its SHACL shape: the report says why, and nothing is stored."""
    with scene.toy() as toy:
        container = toy.subscriptions().url
        body = f"<> a hybrit:Subscription ; hybrit:onResource <{toy.rotation()}> ; lf:minimumInterval -1 ."
        answer = _post(scene.browser, container, body, accept="text/turtle")
        assert answer.status_code == 422, answer.text
        report = graph_of(answer.content, "text/turtle", container)
        assert (None, SH.conforms, Literal(False)) in report
        assert list(report.objects(None, SH.resultMessage))
        assert links(answer, str(LDP.constrainedBy)) == [container]
        assert not members(toy.subscriptions())


def test_r1_8_what_cannot_be_subscribed_to_is_422(scene: ObservedFleet) -> None:
    """R1.8: no such resource, one of somebody else's, a container, an unknown media type; nothing is stored."""
    with scene.toy() as toy:
        container = toy.subscriptions().url
        unobservable = (toy.part().url + "/nothing", "http://example.org/", container, scene.root + "nobody/")
        bodies = [f"<> a hybrit:Subscription ; hybrit:onResource <{url}> ." for url in unobservable]
        for media_type in ("image/png", "text/html", "application/vnd.linked-fleet.frame"):
            about = f'hybrit:onResource <{toy.part().url}> ; hybrit:mediaType "{media_type}"'
            bodies.append(f"<> a hybrit:Subscription ; {about} .")
        for body in bodies:
            answer = _post(scene.browser, container, body)
            assert (answer.status_code, bool(answer.json()["detail"])) == (422, True), (body, answer.text)
        fine = f"<> a hybrit:Subscription ; hybrit:onResource <{toy.rotation()}> ."
        assert _post(scene.browser, container, "<> <broken").status_code == 400
        assert _post(scene.browser, container, fine, content_type="text/plain").status_code == 415
        assert _post(scene.browser, container, fine, accept="image/png").status_code == 406
        assert scene.browser.http.put(container, content=fine, headers=_TURTLE).status_code == 405
        assert not members(toy.subscriptions())


def test_r1_8_too_many_per_client_is_429(tmp_path: Path) -> None:
    """A client at its limit gets a problem for each kind, and nothing more is stored."""
    with observed_fleet(Place(tmp_path), "--subscriptions-per-client", "2") as scene, scene.toy() as toy:
        rotation, container = toy.rotation(), toy.subscriptions().url
        body = f"<> a hybrit:Subscription ; hybrit:onResource <{rotation}>"
        callback = 'hybrit:callbackURL "http://127.0.0.1:9/"'
        one, two = _stream(scene, toy), _stream(scene, toy)
        upgrade = {"upgrade": "callback", "connection": "upgrade", "callback": "http://127.0.0.1:9/"}
        answers = (
            _post(scene.browser, container, body + " ."),
            _post(scene.browser, container, f"{body} ; {callback} ."),
            scene.browser.http.get(rotation, headers=upgrade),
            scene.browser.http.get(rotation, headers={"accept": EVENTS}),
        )
        for answer in answers:
            assert answer.status_code == 429
            assert answer.headers["content-type"] == "application/problem+json"
            assert "Delete some" in answer.json()["detail"]
        refusal = refused(rotation)
        assert (refusal.status_code, "Delete some" in json.loads(refusal.body)["detail"]) == (429, True)
        assert members(toy.subscriptions()) == {one, two}
        with Socket(one) as socket:  # existing ones may be opened
            socket.next("text/turtle")
        assert scene.browser.http.delete(two).status_code == 204
        with Socket(rotation) as socket:
            socket.next()
