"""R0.13, R0.14, R0.16 and R0.17 of the paper: HTTP callbacks, with a real receiver on loopback."""

import base64
import hashlib
import hmac
import http.client
from collections.abc import Iterator
from urllib.parse import urlsplit

import httpx
import pytest
from rdflib import RDF, XSD, Literal, URIRef
from rdflib.compare import isomorphic

from browser import HYBRIT, LF, links
from receivers import CallbackReceiver, Seen
from running import eventually
from small_fleet import Place
from subscribers import FORMATS, ObservedFleet, TwoJointRobot, angle_in, graph_of, members, observed_fleet, said

pytestmark = pytest.mark.virtual

_UPGRADE = {"Upgrade": "callback", "Connection": "Upgrade"}
_SECRET = base64.b64encode(b"0123456789abcdef0123456789abcdef").decode()


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ObservedFleet]:
    with observed_fleet(Place(tmp_path_factory.mktemp("callbacks"))) as opened:
        yield opened


def _subscribe(scene: ObservedFleet, url: str, callback: str, **fields: str) -> httpx.Response:
    return scene.browser.http.get(url, headers=_UPGRADE | {"Callback": callback} | fields)


def _delete(scene: ObservedFleet, url: str) -> None:
    assert scene.browser.http.delete(url).status_code == 204


def _deliveries(receiver: CallbackReceiver, count: int) -> list[Seen]:
    return receiver.wait(count, "/callback", "POST")


def test_r0_16_upgrade_callback_creates_a_subscription(scene: ObservedFleet, receiver: CallbackReceiver) -> None:
    """R0.16: 201 with Location, and Figure 4 as the body; the container lists it, and deliveries begin."""
    with scene.toy() as toy:
        answer = _subscribe(scene, toy.rotation(), receiver.url())
        assert answer.status_code == 201, answer.text
        assert answer.headers["cache-control"] == "no-store"
        url = answer.headers["location"]
        described = graph_of(answer.content, "text/turtle", url)
        figure = {
            (RDF.type, HYBRIT.Subscription),
            (RDF.type, HYBRIT.WebCallback),
            (HYBRIT.onResource, URIRef(toy.rotation())),
            (HYBRIT.callbackURL, Literal(receiver.url(), datatype=XSD.anyURI)),
            (HYBRIT.mediaType, Literal("text/turtle")),
            (URIRef("http://purl.org/dc/terms/identifier"), Literal(url.rpartition("/")[2])),
        }
        assert figure <= set(described.predicate_objects(URIRef(url)))
        assert members(toy.subscriptions()) == {url}
        _deliveries(receiver, 1)
        _delete(scene, url)


def test_r0_13_deliveries_are_complete_and_in_order(scene: ObservedFleet, receiver: CallbackReceiver) -> None:
    """R0.13: the present state, then each change; id, resource and version in the header, numbers without a gap."""
    with scene.toy(0.25) as toy:
        url = _subscribe(scene, toy.rotation(), receiver.url()).headers["location"]
        for count, angle in enumerate((0.25, 0.5, 0.75), 1):
            toy.pose(angle)
            seen = _deliveries(receiver, count)[-1]
            message = said(seen.body, "text/turtle", toy.rotation())
            assert (message.angle, str(message.iri)) == (angle, toy.rotation())
            assert isomorphic(message.state, scene.browser.page(toy.rotation()).graph)
            assert seen.headers["linked-fleet-version"] == message.version
        log = _deliveries(receiver, 3)
        for seen in log:
            assert seen.headers["content-type"] == "text/turtle; charset=utf-8"
            answer = httpx.Response(200, headers={"link": seen.headers["link"]})
            assert links(answer, "self") == [toy.rotation()]
            assert links(answer, "related") == [url]
            assert int(seen.headers["webhook-timestamp"]) > 1_700_000_000
            assert "webhook-signature" not in seen.headers
        numbers = [int(seen.headers["linked-fleet-delivery"]) for seen in log]
        assert numbers == list(range(numbers[0], numbers[0] + 3))
        assert len({seen.headers["webhook-id"] for seen in log}) == 3

        def delivered() -> bool:
            page = scene.browser.page(url)
            return (page.iri, LF.lastStatus, Literal(204)) in page.graph and page.one(LF.lastDelivery) != LF.unknown

        eventually(delivered, "the state of delivery in the description")
        assert scene.browser.page(url).one(LF.deliveryState) == LF.active
        _delete(scene, url)


def test_r0_16_connection_stays_usable(scene: ObservedFleet, receiver: CallbackReceiver) -> None:
    """R0.16: never 101: the next request on the same connection is answered, even after a refusal."""
    with scene.toy() as toy:
        parts = urlsplit(toy.rotation())
        connection = http.client.HTTPConnection(parts.netloc, timeout=15)
        connection.connect()
        socket = connection.sock
        for callback, status in ((receiver.url(), 201), ("ftp://127.0.0.1/", 400), (receiver.url(), 201)):
            connection.request("GET", parts.path, headers=_UPGRADE | {"Callback": callback})
            answer = connection.getresponse()
            answer.read()
            assert answer.status == status
            connection.request("GET", parts.path)
            plain = connection.getresponse()
            assert (plain.status, b"@prefix" in plain.read()) == (200, True)
            assert connection.sock is socket
        connection.close()
        for url in members(toy.subscriptions()):
            _delete(scene, url)


def test_r0_14_unusable_callbacks_are_refused(scene: ObservedFleet) -> None:
    """R0.14, R0.16: a problem that says what is wrong, by Upgrade and by POST; nothing is stored."""
    with scene.toy() as toy:
        container, rotation = toy.subscriptions(), toy.rotation()
        for callback in ("ftp://127.0.0.1/x", "receiver", "http://user:secret@127.0.0.1/x", "http://10.0.0.1/"):
            body = f"""@prefix hybrit: <{HYBRIT}> .
                [] a hybrit:Subscription ; hybrit:onResource <{rotation}> ; hybrit:callbackURL "{callback}" ."""
            posted = scene.browser.http.post(container.url, content=body, headers={"content-type": "text/turtle"})
            for answer in (_subscribe(scene, rotation, callback), posted):
                assert answer.status_code in (400, 422), callback
                assert answer.headers["content-type"] == "application/problem+json"
                assert "callback" in answer.json()["detail"].lower(), answer.text
            assert posted.status_code == 422
        assert not members(toy.subscriptions())


def test_r0_16_callback_field_is_needed_once(scene: ObservedFleet) -> None:
    """R0.16: without Callback, with an empty one and with two it is 400, and nothing is stored."""
    with scene.toy() as toy:
        for callbacks in ([], [""], ["http://127.0.0.1:9/a", "http://127.0.0.1:9/b"]):
            fields = [*_UPGRADE.items(), *(("Callback", each) for each in callbacks)]
            answer = scene.browser.http.get(toy.rotation(), headers=fields)
            assert answer.status_code == 400, callbacks
            assert "callback" in answer.json()["detail"].lower()
        assert not members(toy.subscriptions())


@pytest.mark.parametrize("media_type", FORMATS)
def test_r0_17_accept_decides_the_type_of_deliveries(
    scene: ObservedFleet, receiver: CallbackReceiver, media_type: str
) -> None:
    """R0.17: every delivery is of the negotiated type, and so is the description that answers."""
    with scene.toy() as toy:
        answer = _subscribe(scene, toy.rotation(), receiver.url(), Accept=f"image/png, {media_type};q=0.5")
        assert answer.headers["content-type"].partition(";")[0] == media_type
        url = answer.headers["location"]
        for count, angle in enumerate((0.0, 0.5), 1):
            toy.pose(angle)
            seen = _deliveries(receiver, count)[-1]
            assert seen.headers["content-type"].partition(";")[0] == media_type
            assert said(seen.body, media_type, toy.rotation()).angle == angle
        _delete(scene, url)


def test_r0_17_binary_frames_are_delivered(scene: ObservedFleet, receiver: CallbackReceiver) -> None:
    """R0.17: the joint state's own type is delivered too; the description is in RDF."""
    frame = "application/vnd.linked-fleet.frame"
    with scene.toy() as toy:
        state = str(toy.page.one(LF.jointState))
        answer = _subscribe(scene, state, receiver.url(), Accept=frame)
        assert answer.headers["content-type"] == "text/turtle; charset=utf-8"
        seen = _deliveries(receiver, 1)[0]
        assert seen.headers["content-type"] == frame
        assert f'<{state}/layout>; rel="describedby"' in seen.headers["link"]
        assert seen.body == scene.browser.http.get(state, headers={"accept": frame}).content
        _delete(scene, answer.headers["location"])


def test_signature_proves_where_a_delivery_comes_from(scene: ObservedFleet, receiver: CallbackReceiver) -> None:
    """Standard Webhooks: id, time and body are signed with the secret, which is shown nowhere."""
    with scene.toy() as toy:
        url = _posted(scene, toy, f'hybrit:callbackURL "{receiver.url()}" ; lf:secret "whsec_{_SECRET}"')
        (seen,) = _deliveries(receiver, 1)
        signed = f"{seen.headers['webhook-id']}.{seen.headers['webhook-timestamp']}.".encode() + seen.body
        digest = hmac.new(base64.b64decode(_SECRET), signed, hashlib.sha256).digest()
        assert seen.headers["webhook-signature"] == "v1," + base64.b64encode(digest).decode()
        page = scene.browser.page(url)
        assert (page.iri, LF.signed, Literal(True)) in page.graph
        assert _SECRET not in page.response.text + toy.subscriptions().response.text
        _delete(scene, url)


def test_r0_13_presence_is_delivered(scene: ObservedFleet, receiver: CallbackReceiver) -> None:
    """R0.13: a callback on a robot gets a message when its agent has gone, and its deadband suppresses small moves."""
    with scene.toy() as toy:
        robot = toy.page.url
        url = _subscribe(scene, robot + "?depth=this", receiver.url()).headers["location"]
        rough = _subscribe(scene, toy.rotation() + "?deadband=0.4", receiver.url("/rough")).headers["location"]
        receiver.wait(1, "/rough", "POST"), _deliveries(receiver, 1)
        for angle in (0.1, 0.3, 0.5):
            toy.pose(angle)
            eventually(lambda angle=angle: _angle(scene, toy) == angle, "the frame")
        seen = receiver.wait(2, "/rough", "POST")[-1]
        assert said(seen.body, "text/turtle", toy.rotation()).angle == 0.5
    last = _deliveries(receiver, 2)[-1]
    assert (URIRef(robot), LF.presence, LF.offline) in graph_of(last.body, "text/turtle", robot)
    _delete(scene, url)
    _delete(scene, rough)


def _angle(scene: ObservedFleet, toy: TwoJointRobot) -> float:
    page = scene.browser.page(toy.rotation())
    return angle_in(page.graph, page.iri)


def _posted(scene: ObservedFleet, toy: TwoJointRobot, more: str) -> str:
    body = f"""@prefix hybrit: <{HYBRIT}> . @prefix lf: <{LF}> .
        [] a hybrit:Subscription ; hybrit:onResource <{toy.rotation()}> ; {more} ."""
    answer = scene.browser.http.post(toy.subscriptions().url, content=body, headers={"content-type": "text/turtle"})
    assert answer.status_code == 201, answer.text
    return answer.headers["location"]


@pytest.mark.parametrize(
    "fields",
    [
        {},
        {"Connection": "Upgrade"},
        {"Upgrade": "callback"},
        {"Upgrade": "h2c", "Connection": "Upgrade"},
        {"Accept": "text/event-stream"},
    ],
    ids=str,
)
def test_a_callback_without_its_upgrade_names_the_other_way(scene: ObservedFleet, fields: dict[str, str]) -> None:
    """RFC 9110, 7.8: proxies and HTTP/2 remove Upgrade. The GET would be answered, and nothing be subscribed to."""
    with scene.toy() as toy:
        rotation, container = toy.rotation(), toy.subscriptions()
        answer = scene.browser.http.get(rotation, headers={"Callback": "http://127.0.0.1:9/", **fields})
        assert (answer.status_code, answer.headers["upgrade"]) == (426, "callback")
        assert answer.headers["connection"] == "Upgrade"
        assert f"POST a description of the subscription to {container.url} instead" in answer.json()["detail"]
        assert not members(toy.subscriptions())
        assert scene.browser.http.head(rotation, headers={"Callback": "http://127.0.0.1:9/"}).status_code == 200
