"""Cameras over HTTP: a robot with pictures, one without a renderer, and one with invalid pictures."""

import contextlib
import itertools
import struct
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

import httpx
import pyshacl
import pytest
import rdflib
import zenoh
from msgspec.structs import replace
from rdflib import URIRef
from websockets.exceptions import InvalidStatus

from browser import DCTERMS, HYBRIT, LDP, LF, SH, Browser, Page
from camera_robot import BLIND, DEPTH, EYE, JPEG, PNG, CameraRobot
from connections import websocket
from fake_robots import FakeRobot, open_session
from linked_fleet_agent.wire.codec import HEADER, PictureHeader, encode_picture
from linked_fleet_agent.wire.messages import Camera
from running import eventually
from small_fleet import Place

pytestmark = pytest.mark.virtual
SOSA = rdflib.Namespace("http://www.w3.org/ns/sosa/")
SECONDS = 15


@dataclass
class Hall:
    browser: Browser
    session: zenoh.Session
    names: Iterator[str] = field(default_factory=lambda: (f"seer{number}" for number in itertools.count()))

    def seer(self, *cameras: Camera) -> tuple[CameraRobot, Page]:
        """Return a robot, and the page of its first camera."""
        seer = CameraRobot(FakeRobot(self.session, next(self.names))).appear(*cameras)
        return seer, self.camera(seer.actor.name)

    def camera(self, robot: str) -> Page:
        """By links: fleet, robot, cameras, camera."""

        def probe() -> Page | None:
            with contextlib.suppress(AssertionError):
                found = self.browser.robot(robot)
                if found.one(LF.presence) == LF.online and (found.iri, LF.cameras, None) in found.graph:
                    return found
            return None

        cameras = self.browser.page(str(eventually(probe, f"{robot} with cameras").one(LF.cameras)))
        return self.browser.page(str(next(iter(sorted(cameras.graph.objects(cameras.iri, LDP.contains))))))


@pytest.fixture(scope="module")
def hall(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Hall]:
    place = Place(tmp_path_factory.mktemp("state"))
    with place.gateway() as (_, browser), open_session(place.zenoh) as session:
        yield Hall(browser, session)


def get(page: Page, accept: str, **headers: str) -> httpx.Response:
    return httpx.get(page.url, headers={"accept": accept, **headers}, timeout=SECONDS)


def watch(page: Page, subprotocol: str, query: str = "") -> Any:
    return websocket(page.url + query, {}, subprotocol)


def test_the_fleet_lists_the_cameras_of_all_robots_that_are_there(hall: Hall) -> None:
    first, second = hall.seer(EYE)[1], hall.seer(EYE, BLIND)[1]
    root = hall.browser.page(hall.browser.root)
    wall = hall.browser.page(str(root.one(LF.allCameras)))
    listed = set(wall.graph.objects(wall.iri, LDP.contains))
    assert {first.iri, second.iri} <= listed
    assert str(next(wall.graph.objects(first.iri, LF.ofRobot))) == first.url.partition("cameras")[0]
    blueprint = hall.browser.page(wall.url + "/blueprint").graph
    assert pyshacl.validate(wall.graph, shacl_graph=blueprint)[0]


def test_a_camera_is_described_and_leads_to_its_link_and_back(hall: Hall) -> None:
    seer, page = hall.seer(EYE)
    assert {LF.Camera, SOSA.Sensor, HYBRIT.Property} <= set(page.graph.objects(page.iri, rdflib.RDF.type))
    link = hall.browser.page(str(page.one(SOSA.isHostedBy)))
    assert link.one(SOSA.hosts) == page.iri
    assert (int(str(page.one(LF.imageWidth))), int(str(page.one(LF.imageHeight)))) == (4, 3)
    assert page.one(LF.picture) == page.iri
    assert rdflib.Literal("image/jpeg") in set(page.graph.objects(page.iri, DCTERMS.format))
    assert seer.asked == []


@pytest.mark.parametrize(("accept", "content"), [("image/jpeg", JPEG), ("image/png", PNG), ("image/*", JPEG)], ids=str)
def test_the_picture_is_had_by_accept(hall: Hall, accept: str, content: bytes) -> None:
    _, page = hall.seer(EYE)
    answer = get(page, accept)
    assert (answer.status_code, answer.content) == (200, content)
    assert answer.headers["cache-control"] == "no-store"
    assert answer.headers["x-content-type-options"] == "nosniff"
    assert answer.headers["content-security-policy"].startswith("sandbox")
    assert answer.headers["last-modified"] == "Tue, 14 Nov 2023 22:13:20 GMT"
    assert answer.headers["vary"] == "Accept"
    assert get(page, accept, **{"if-none-match": "*"}).status_code == 304
    assert get(page, "text/turtle").headers["content-type"].startswith("text/turtle")
    assert (
        httpx.get(page.url, headers={"accept": "text/html,*/*;q=0.8"}).headers["content-type"].startswith("text/html")
    )


def test_a_picture_is_refused_if_it_is_not_the_one_of_the_precondition(hall: Hall) -> None:
    _, page = hall.seer(EYE)
    assert get(page, "image/png", **{"if-match": '"another"'}).status_code == 412
    assert get(page, "image/png", **{"if-match": "*"}).status_code == 200


def test_depth_is_a_frame_that_its_layout_describes(hall: Hall) -> None:
    _, page = hall.seer(EYE)
    frame = get(page, "application/octet-stream")
    layout = hall.browser.page(frame.links["describedby"]["url"])
    fields = {str(layout.graph.value(node, LF.fieldName)): node for node in layout.graph.objects(layout.iri, LF.field)}
    depth = fields["depth"]
    offset, count = (int(str(layout.graph.value(depth, each))) for each in (LF.byteOffset, LF.valueCount))
    assert str(layout.graph.value(depth, LF.fieldType)) == "float32"
    assert frame.content[offset:] == DEPTH and count == 12
    assert len(frame.content) == int(str(layout.one(LF.byteSize))) == HEADER.size + len(DEPTH)
    (rows,) = struct.unpack_from("<H", frame.content, int(str(layout.graph.value(fields["rows"], LF.byteOffset))))
    assert rows == 3


def test_only_requests_for_bytes_query_the_robot(hall: Hall) -> None:
    seer, page = hall.seer(EYE)
    answer = httpx.head(page.url, headers={"accept": "image/jpeg"})
    assert (answer.status_code, answer.headers["content-type"]) == (200, "image/jpeg")
    assert "content-length" not in answer.headers and "etag" not in answer.headers
    assert get(page, "image/gif").status_code == 406
    assert seer.asked == []


def test_a_stream_is_of_pictures_and_ends_with_its_last_follower(hall: Hall) -> None:
    """Two clients follow it, and the robot is asked once for both; followers of the description get no pictures."""
    seer, page = hall.seer(EYE)
    with (
        watch(page, "lf.turtle") as said,
        watch(page, "lf.jpeg") as one,
        watch(page, "lf.jpeg", "?interval=0.2") as two,
    ):
        said.recv(SECONDS)
        assert [one.recv(SECONDS) for _ in range(4)] == [JPEG] * 4
        assert two.recv(SECONDS) == JPEG
        assert {each.format for each in seer.asked} == {"jpeg"}
        with pytest.raises(TimeoutError):
            said.recv(1)
    with watch(page, "lf.frame") as depths:
        assert depths.recv(SECONDS)[HEADER.size :] == DEPTH
    time.sleep(5)
    before = len(seer.asked)
    time.sleep(5)
    assert len(seer.asked) == before


def test_a_stream_is_made_by_post_and_a_callback_is_refused(hall: Hall) -> None:
    _, page = hall.seer(EYE)
    container = str(hall.browser.page(str(page.one(rdflib.RDFS.seeAlso))).one(HYBRIT.subscriptions))
    body = f"""@prefix hybrit: <{HYBRIT}> . [] a hybrit:Subscription ;
        hybrit:onResource <{page.url}> ; hybrit:mediaType "image/jpeg" """
    made = httpx.post(container, content=body + ".", headers={"content-type": "text/turtle"})
    assert made.status_code == 201, made.text
    with websocket(made.headers["location"], {}) as stream:
        assert stream.recv(SECONDS) == JPEG
    callback = f'; a hybrit:WebCallback ; hybrit:callbackURL "http://127.0.0.1:{9}/" .'
    refused = httpx.post(container, content=body + callback, headers={"content-type": "text/turtle"})
    assert refused.status_code == 409 and "streams alone" in refused.json()["detail"]


def malformed(hall: Hall) -> float:
    said = httpx.get(hall.browser.root + "metrics").text
    (line,) = [each for each in said.splitlines() if "messages_malformed" in each and not each.startswith("#")]
    return float(line.split()[-1])


def _with(content: bytes, **changes: Any) -> bytes:
    return encode_picture("jpeg", PictureHeader(3, 4, 1, 1, 1, 1, 0.1, 9.0)._replace(**changes), content)


@pytest.mark.parametrize(
    ("content", "changes"),
    [
        (b"<html><script>alert(1)</script>", {}),
        (PNG, {}),
        (JPEG[:7] + struct.pack(">HH", 3000, 4000) + JPEG[11:], {}),
        (JPEG, {"rows": 5}),
        (JPEG, {"incarnation": 2**40}),
        (JPEG, {"far_m": 8.0}),
    ],
    ids=["a page", "another format", "another size inside", "another size outside", "another run", "another range"],
)
def test_an_invalid_picture_is_counted_and_not_served(hall: Hall, content: bytes, changes: dict[str, Any]) -> None:
    seer, page = hall.seer(EYE)
    seer.payload = _with(content, **({"incarnation": seer.actor.incarnation} | changes))
    before = malformed(hall)
    answer = get(page, "image/jpeg")
    assert answer.status_code == 504
    assert answer.headers["content-type"].startswith("application/problem+json")
    assert malformed(hall) == before + 1


def test_a_picture_that_is_too_large_is_not_taken(hall: Hall) -> None:
    seer, page = hall.seer(EYE)
    seer.payload = bytes(5 * 2**20)
    answer = get(page, "image/png")
    assert answer.status_code == 504 and "are the most" in answer.json()["detail"]


@pytest.mark.parametrize(
    "wrong",
    [
        replace(EYE, link="nowhere"),
        replace(EYE, orientation_xyzw=(1.0, 1.0, 0.0, 0.0)),
        replace(EYE, near_m=10.0),
        replace(EYE, width=4096, height=4096),
        replace(EYE, name="ö" * 100),
    ],
)
def test_a_camera_that_contradicts_itself_is_left_out(hall: Hall, wrong: Camera) -> None:
    _, page = hall.seer(replace(wrong, name="a" if wrong.name == "eye" else wrong.name), replace(EYE, name="b"))
    assert page.url.endswith("/cameras/b")


def test_without_a_renderer_the_picture_is_unknown_and_says_why(hall: Hall) -> None:
    _, page = hall.seer(BLIND)
    assert (page.one(LF.picture), str(page.one(LF.reason))) == (LF.unknown, "nothing renders here")
    answer = get(page, "image/jpeg")
    assert answer.status_code == 406 and "nothing renders here" in answer.json()["detail"]
    with pytest.raises(InvalidStatus) as refused, watch(page, "lf.jpeg"):
        pass
    assert refused.value.response.status_code == 406


@pytest.mark.parametrize("camera", [EYE, BLIND], ids=["seeing", "blind"])
def test_descriptions_of_cameras_conform_to_their_blueprints(hall: Hall, camera: Camera) -> None:
    _, page = hall.seer(camera)
    above = hall.browser.page(page.url.rpartition("/")[0])
    layouts = [hall.browser.page(f"{page.url}/layout")] if camera.formats else []
    for each in (above, page, *layouts):
        blueprints = [str(iri) for iri in each.graph.objects(each.iri, HYBRIT.blueprint) if hall.browser.root in iri]
        shapes, said = rdflib.Graph().parse(blueprints[0]), rdflib.Graph() + each.graph
        assert set(shapes.objects(None, SH.targetClass)) & set(each.types)
        conforms, _, text = pyshacl.validate(said, shacl_graph=shapes, inference="none")
        assert conforms, text


def test_a_camera_of_an_offline_robot_has_no_picture(hall: Hall) -> None:
    seer, page = hall.seer(EYE)
    seer.actor.leave()
    eventually(lambda: get(page, "image/jpeg").status_code == 503, "the picture of a robot that left is refused")
    assert hall.browser.page(page.url).one(LF.presence) == LF.offline


def test_there_is_nothing_beside_the_cameras(hall: Hall) -> None:
    _, page = hall.seer(EYE)
    above = page.url.rpartition("/")[0]
    for path in (f"{above}/other", f"{page.url}/other", f"{page.url}/layout/other", f"{above}/blueprint/x"):
        assert httpx.get(path).status_code == 404
    for path in (above, page.url, f"{page.url}/layout"):
        assert httpx.get(f"{path}/blueprint").status_code == 200
    assert URIRef(above) == hall.browser.page(above).iri
