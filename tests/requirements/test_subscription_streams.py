"""R0.12, R0.14, R0.15 and R0.17 of the paper by WebSocket and event stream; clients follow links from the root."""

import contextlib
import json
from collections.abc import Iterator
from urllib.parse import urlsplit

import pytest
import rdflib
from rdflib import URIRef
from rdflib.compare import isomorphic

from browser import DCTERMS, HYBRIT, LF, ROS, Browser
from linked_fleet_agent.wire.codec import decode_state
from running import eventually
from shared_fixtures import RunningFleet
from small_fleet import Place, move
from subscribers import (
    ARM,
    EVENTS,
    FORMATS,
    ObservedFleet,
    Said,
    Socket,
    angle_in,
    emptied,
    events,
    graph_of,
    members,
    observed_fleet,
    refused,
)

pytestmark = pytest.mark.virtual

JELLY = "application/x-jelly-rdf"
FRAME = "application/vnd.linked-fleet.frame"


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ObservedFleet]:
    with observed_fleet(Place(tmp_path_factory.mktemp("streams"))) as opened:
        yield opened


def _same(message: Said, browser: Browser, url: str) -> None:
    """Check that a message equals a GET, with its version."""
    assert message.iri == URIRef(url)
    assert isomorphic(message.state, browser.page(url).graph), f"{message.body.decode()}\n{url}"


# -- WebSocket ------------------------------------------------------------------------------------------------------


def test_r0_12_and_r0_15_websocket_on_rotation_joint_robot_and_fleet(scene: ObservedFleet) -> None:
    """R0.12, R0.15: on each, the first message is the present state, and a change is followed by what a GET says."""
    with scene.toy(0.25) as toy:
        rotation, joint, robot, fleet = toy.rotation(), toy.part().url, toy.page.url, scene.root
        with Socket(rotation) as one, Socket(joint) as two, Socket(robot) as three, Socket(fleet) as four:
            for socket in (one, two, three, four):
                _same(socket.next(), scene.browser, socket.url)
            toy.pose(0.5)
            for socket in (one, two, three):
                _same(socket.next(), scene.browser, socket.url)
            assert angle_in(scene.browser.page(rotation).graph, URIRef(rotation)) == 0.5
            with scene.toy() as other:  # for the fleet values are no news, robots are
                appeared = other.page
                news = four.next()
                while (appeared.iri, LF.presence, LF.online) not in news.graph:
                    news = four.next()
            while (appeared.iri, LF.presence, LF.offline) not in news.graph:
                news = four.next()
            _same(news, scene.browser, fleet)


def test_r0_15_websocket_follows_a_motion_to_its_end(browser: Browser) -> None:
    """R0.15: messages follow a real motion, their versions grow, and the last one has the final value."""
    joint = browser.part("panda", "panda_joint2")
    rotation, container = str(joint.one(ROS.rotation)), str(joint.one(HYBRIT.subscriptions))
    with Socket(rotation) as socket:
        first = socket.next()
        assert first.iri == URIRef(rotation)
        goal = first.angle + (0.4 if first.angle < 0.5 else -0.4)
        answer = move(browser, browser.action(joint, LF.Rotate), goal)
        assert answer.status_code == 204
        messages = [first]
        while abs(messages[-1].angle - goal) > 0.02:
            messages.append(socket.next())
        assert len({message.version for message in messages}) == len(messages) > 3
        url = answer.headers["location"]
        eventually(lambda: browser.page(url).one(LF.state) == LF.succeeded, "the end of the motion")

        def settled() -> bool:
            with contextlib.suppress(TimeoutError):
                while True:
                    messages.append(socket.next(patience_s=0.1))
            return isomorphic(messages[-1].state, browser.page(rotation).graph)

        eventually(settled, "the final value")
    emptied(browser, container)


def test_r0_15_websocket_on_an_invocation(browser: Browser) -> None:
    """R0.15: an invocation can be watched until it has succeeded."""
    joint = browser.part("panda", "panda_joint4")
    rotation = str(joint.one(ROS.rotation))
    present = angle_in(browser.page(rotation).graph, URIRef(rotation))
    answer = move(browser, browser.action(joint, LF.Rotate), present + (0.5 if present < -1.5 else -0.5))
    url = answer.headers["location"]
    with Socket(url) as socket:
        states = [socket.next()]
        while (states[-1].iri, LF.state, LF.succeeded) not in states[-1].graph:
            states.append(socket.next())
        assert states[0].graph.value(URIRef(url), LF.state) in (LF.accepted, LF.running)
        _same(states[-1], browser, url)
        assert len({state.version for state in states}) == len(states) > 1
    emptied(browser, str(joint.one(HYBRIT.subscriptions)))


def test_r0_12_and_r0_14_what_cannot_be_observed_says_so(scene: ObservedFleet) -> None:
    """R0.12, R0.14: a missing resource is 404, a container 409, by WebSocket and callback; nothing is created."""
    with scene.toy() as toy:
        container, missing = toy.subscriptions().url, toy.part().url + "/nothing"
        fields = {"upgrade": "callback", "connection": "upgrade", "callback": "http://127.0.0.1:9/"}
        assert refused(missing).status_code == scene.browser.http.get(missing, headers=fields).status_code == 404
        answer, callback = refused(container), scene.browser.http.get(container, headers=fields)
        assert (answer.status_code, callback.status_code) == (409, 409)
        assert "cannot be subscribed to" in json.loads(answer.body)["detail"]
        assert callback.headers["content-type"] == "application/problem+json"
        assert not members(toy.subscriptions())


def test_r0_12_a_resource_that_ceases_closes_its_stream(scene: ObservedFleet) -> None:
    """R0.12: if a new run of the robot lacks the joint, its watchers get close code 4404."""
    with scene.toy() as toy, Socket(toy.rotation()) as socket, events(toy.rotation()) as stream:
        socket.next(), stream.next()
        toy.actor.incarnation += 1
        toy.actor.appear(toy.actor.description(ARM.replace("elbow", "wrist"), ("shoulder", "wrist")))
        assert socket.until_closed() == (4404, "the resource does not exist any more")
        while not stream.ended():  # the end of the former run came first
            pass
        assert stream.last_event_id == "cancelled"


# -- Upgrade --------------------------------------------------------------------------------------------------------


def test_r0_14_upgrade_counts_only_as_a_connection_option(scene: ObservedFleet) -> None:
    """R0.14: without ``Connection: Upgrade``, and for unknown protocols, Upgrade is ignored; nothing is created."""
    with scene.toy() as toy:
        url = toy.rotation()
        ignored = (
            {"upgrade": "websocket"},
            {"upgrade": "callback"},
            {"upgrade": "callback", "connection": "keep-alive"},
            {"upgrade": "h2c, rosbridge/2", "connection": "upgrade"},
        )
        plain = scene.browser.page(url)
        for fields in ignored:
            answer = scene.browser.http.get(url, headers=fields)
            assert (answer.status_code, answer.headers["content-type"]) == (200, "text/turtle; charset=utf-8"), fields
            assert isomorphic(graph_of(answer.content, "text/turtle", url), plain.graph)
        assert not members(toy.subscriptions())


def test_r0_15_an_opening_without_its_key_is_refused(scene: ObservedFleet) -> None:
    """RFC 6455, 4.2.2: a WebSocket handshake without Sec-WebSocket-Key gets 400; HEAD and other methods ignore it."""
    with scene.toy() as toy:
        fields = {"upgrade": "websocket", "connection": "upgrade", "sec-websocket-version": "13"}
        answer = scene.browser.http.get(toy.rotation(), headers=fields)
        assert answer.status_code == 400
        assert "Sec-WebSocket-Key" in answer.json()["detail"]
        assert scene.browser.http.head(toy.rotation(), headers=fields).status_code == 200


def test_r0_14_head_creates_nothing(scene: ObservedFleet) -> None:
    """R0.14: HEAD with any form of subscribing is answered like a HEAD, and the container stays empty."""
    with scene.toy() as toy:
        key = {"sec-websocket-key": "dGhlIHNhbXBsZSBub25jZQ==", "sec-websocket-version": "13"}
        for fields in (
            {"upgrade": "callback", "connection": "upgrade", "callback": "http://127.0.0.1:9/"},
            {"upgrade": "websocket", "connection": "upgrade", **key},
            {"accept": EVENTS},
        ):
            answer = scene.browser.http.head(toy.rotation(), headers=fields)
            assert (answer.status_code, answer.content) == (200, b""), fields
            assert "location" not in answer.headers
        assert not members(toy.subscriptions())


# -- media types ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("media_type", FORMATS)
def test_r0_17_accept_decides_the_type_of_every_message(scene: ObservedFleet, media_type: str) -> None:
    """R0.17: each message of a WebSocket and of an event stream is of the type that was asked for."""
    with scene.toy() as toy:
        url = toy.rotation()
        accept = f"{media_type};q=0.9, text/turtle;q=0.1, image/png"
        with Socket(url, accept) as socket, events(url, f"{EVENTS}, {accept}") as stream:
            for angle in (0.0, 0.5):
                toy.pose(angle)
                for message in (socket.next(media_type), stream.next(media_type)):
                    assert message.angle == angle
                    _same(message, scene.browser, url)
            for channel in (socket, stream):
                shown = scene.browser.page(channel.description)
                assert str(shown.graph.value(shown.iri, HYBRIT.mediaType)) == media_type


def test_r0_17_turtle_by_default(scene: ObservedFleet) -> None:
    """R0.17: Turtle for a WebSocket that cannot say Accept, as in a browser, and for an EventSource."""
    with scene.toy() as toy, Socket(toy.rotation()) as socket, events(toy.rotation()) as stream:
        assert socket.connection.subprotocol is None
        for message in (socket.next(), stream.next()):
            assert message.body.startswith(b"@base ")
            _same(message, scene.browser, toy.rotation())


def test_r0_17_event_stream_is_chosen_by_preference(scene: ObservedFleet) -> None:
    """R0.17: a client that prefers a plain type to an event stream gets that; nothing is created."""
    with scene.toy() as toy:
        for accept in ("text/turtle, text/event-stream;q=0.5", "text/event-stream;q=0, */*"):
            answer = scene.browser.http.get(toy.rotation(), headers={"accept": accept})
            assert answer.headers["content-type"] == "text/turtle; charset=utf-8", accept
        assert not members(toy.subscriptions())


@pytest.mark.parametrize(
    ("name", "media_type"),
    [
        ("lf.turtle", "text/turtle"),
        ("lf.jsonld", "application/ld+json"),
        ("lf.ntriples", "application/n-triples"),
        ("lf.rdfxml", "application/rdf+xml"),
    ],
)
def test_r0_17_subprotocols_are_for_browsers(scene: ObservedFleet, name: str, media_type: str) -> None:
    """R0.17: the subprotocol names the type of every message, and is confirmed."""
    with scene.toy() as toy, Socket(toy.rotation(), subprotocol=name) as socket:
        assert socket.connection.subprotocol == name
        for angle in (0.0, 0.5):
            toy.pose(angle)
            assert socket.next(media_type).angle == angle


def test_r0_17_the_query_picks_a_type_for_every_channel(scene: ObservedFleet) -> None:
    """R0.17: as in links, also where it would be Turtle; an unknown word is no type."""
    with scene.toy() as toy:
        url = f"{toy.rotation()}?as=jsonld"
        with Socket(url) as socket, events(url) as stream:
            for channel in (socket, stream):
                assert channel.next("application/ld+json").angle == 0.0
        fields = {"connection": "upgrade", "upgrade": "callback", "callback": "http://127.0.0.1:9/"}
        made = scene.browser.http.get(url, headers=fields)
        assert made.status_code == 201, made.text
        shown = scene.browser.page(made.headers["location"])
        assert str(shown.one(HYBRIT.mediaType)) == "application/ld+json"
        scene.browser.http.delete(shown.url)
        assert refused(f"{toy.rotation()}?as=nothing").status_code == 406


def test_r0_17_binary_frames(scene: ObservedFleet) -> None:
    """R0.17: the joint state comes as the agent's own frames, by subprotocol or Accept, in binary messages."""
    with scene.toy(0.25) as toy:
        state = str(toy.page.one(LF.jointState))
        with Socket(state, subprotocol="lf.frame") as one, Socket(state, accept=FRAME) as two:
            for angle in (0.25, 0.5):
                toy.pose(angle, 0.125)
                for socket in (one, two):
                    body = socket.raw()
                    while isinstance(body, bytes) and decode_state(body).positions != (0.125, angle):
                        body = socket.raw()  # the state before the frame
                    assert isinstance(body, bytes)
        answer = refused(toy.part().url, subprotocol="lf.frame")
        assert answer.status_code == 406
        assert "lf.frame" not in json.loads(answer.body)["detail"]


def test_r0_17_jelly(scene: ObservedFleet) -> None:
    """R0.17: each message in Jelly, binary and complete in itself; not available as an event, which is text."""
    with scene.toy() as toy:
        url = toy.rotation()
        with (
            Socket(url, subprotocol="lf.jelly") as one,
            Socket(url, accept=JELLY) as two,
            events(url, f"{EVENTS}, {JELLY}") as stream,
        ):
            for angle in (0.0, 0.5):
                toy.pose(angle)
                assert stream.next().angle == angle
                for socket in (one, two):
                    body = socket.raw()
                    assert isinstance(body, bytes)
                    graph = rdflib.Graph().parse(data=body, format="jelly")
                    assert angle_in(graph, URIRef(url)) == angle
                    assert graph.value(URIRef(url), LF.version)
        answer = scene.browser.http.get(url, headers={"accept": JELLY})
        assert answer.headers["content-type"] == JELLY
        again = scene.browser.http.get(url + "?as=jelly", headers={"if-none-match": answer.headers["etag"]})
        assert again.status_code == 304
        assert isomorphic(rdflib.Graph().parse(data=answer.content, format="jelly"), scene.browser.page(url).graph)


def test_r0_17_unacceptable_types_are_406_with_what_there_is(scene: ObservedFleet) -> None:
    """R0.17: 406 lists the available types, and for a WebSocket the subprotocols as well."""
    with scene.toy() as toy:
        url = toy.rotation()
        callback = {"upgrade": "callback", "connection": "upgrade", "callback": "http://127.0.0.1:9/"}
        answer = scene.browser.http.get(url, headers={"accept": "image/png", **callback})
        assert answer.status_code == 406
        details = [answer.json()["detail"]]
        for refusal in (refused(url, accept="image/png"), refused(url, subprotocol="lf.yaml")):
            assert refusal.status_code == 406
            details.append(json.loads(refusal.body)["detail"])
            assert all(name in details[-1] for name in ("lf.turtle", "lf.jsonld", "lf.ntriples", "lf.rdfxml"))
        assert all(media_type in detail for detail in details for media_type in FORMATS)
        assert not members(toy.subscriptions())


# -- what is news: tests/gateway/subscriptions/test_fan_out.py has the rest -----------------------------------------


def test_presence_is_news_of_all_that_a_robot_has(scene: ObservedFleet) -> None:
    """When a robot goes, subscribers of the robot, its parts and properties, and of the fleet get a message."""
    with scene.toy() as toy:
        robot, urls = toy.page.url, [toy.page.url, toy.part().url, toy.rotation(), toy.part("tip").url]
        sockets = [Socket(url) for url in [*urls, scene.root, urls[0] + "?depth=this", urls[1] + "?depth=this"]]
        for socket in sockets:
            socket.next()
    for socket in sockets:
        with socket:
            message = socket.next()
            assert (URIRef(robot), LF.presence, LF.offline) in message.graph or message.iri not in (
                URIRef(robot),
                URIRef(scene.root),
            )
            _same(message, scene.browser, socket.url.partition("?")[0])


def test_subtree_watches_a_robot_on_one_connection(scene: ObservedFleet) -> None:
    """``depth=subtree``: all below the robot, each once; then each message is one resource that changed.

    The version of one resource says nothing about the others, so who resumes gets the whole subtree.
    """
    with scene.toy() as toy, Socket(toy.page.url + "?depth=subtree") as socket:
        parts = [scene.browser.page(str(part)) for part in toy.page.graph.objects(toy.page.iri, DCTERMS.hasPart)]
        covered = {page.url for page in (toy.page, *parts)}
        things = (toy.page, *parts)
        covered |= {str(each) for page in things for each in page.graph.objects(page.iri, HYBRIT.property)}
        covered -= {str(toy.page.one(LF.jointState))}  # it repeats the values of the joints
        first = [socket.next() for _ in covered]
        assert {str(message.iri) for message in first} == covered
        for message in first:
            _same(message, scene.browser, str(message.iri))
        toy.pose(0.5)
        moved = {toy.rotation(), str(toy.part("tip").one(LF.pose))}
        news = [socket.next() for _ in moved]
        assert {str(message.iri) for message in news} == moved
        for message in news:
            _same(message, scene.browser, str(message.iri))
        assert {message.previous for message in news} <= {message.version for message in first}
        last = max(news, key=lambda message: [int(n) for n in message.version.replace(".", "-").split("-")]).event_id
        with events(socket.url, last=last) as stream, Socket(socket.url, last=last) as again:
            for channel in (stream, again):
                assert {str(channel.next().iri) for _ in covered} == covered
        joint = toy.part()  # without the other one
        below = {joint.url, *(str(each) for each in joint.graph.objects(joint.iri, HYBRIT.property))}
        with Socket(joint.url + "?depth=subtree") as part:
            assert {str(part.next().iri) for _ in below} == below


# -- options --------------------------------------------------------------------------------------------------------


def test_options_that_do_not_exist_are_refused(scene: ObservedFleet) -> None:
    with scene.toy() as toy:
        for query in ("deadband=-1", "deadband=nan", "interval=1e9", "interval=x", "depth=all", "intervall=1",
                      "depth=this&depth=this"):  # fmt: skip
            url = f"{toy.rotation()}?{query}"
            assert refused(url).status_code == 400, query
            assert scene.browser.http.get(url, headers={"accept": EVENTS}).status_code == 400, query


def test_r0_12_streams_under_every_name_of_the_gateway(fleet: RunningFleet, browser: Browser) -> None:
    """R0.12: requests under another public name of the gateway are answered with that name's IRIs."""
    joint = browser.part("baxter", "right_w0")
    path, port = urlsplit(str(joint.one(ROS.rotation))).path, urlsplit(fleet.root).port
    with Socket(f"http://localhost:{port}{path}") as socket:
        message = socket.next()
        assert str(message.iri) == f"http://localhost:{port}{path}"
        assert socket.description.startswith(f"http://localhost:{port}/")
        assert isinstance(message.graph, rdflib.Graph)
    emptied(browser, str(joint.one(HYBRIT.subscriptions)))
