"""The map of the floor: uploaded as curl does, shared by gateways, read in each form, and refused with a sentence."""

from collections.abc import Iterator
from pathlib import Path

import httpx
import pyshacl
import pytest
import rdflib
from rdflib import RDF

from authenticated_gateway import run_authenticated
from browser import DCTERMS, HYBRIT, LF, MATHS, SH, VOM, Browser, Page
from floor_maps import FREE, UNKNOWN, WALL, pgm, upload, yaml
from gateway_group import Gateway, gateways, hub
from linked_fleet_gateway.extensions.world.floor_map import MAX_UPLOAD_BYTES
from redis_servers import single
from running import eventually
from subscribers import Socket

pytestmark = pytest.mark.virtual
ROWS = ((WALL, WALL, WALL, WALL), (WALL, FREE, FREE, UNKNOWN), (WALL, FREE, FREE, UNKNOWN))
IMAGE = pgm(ROWS)


@pytest.fixture(scope="module")
def both(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Gateway, Gateway]]:
    with (
        single(tmp_path_factory.mktemp("redis")) as server,
        hub() as fleet,
        gateways(fleet, server.url) as (one, other),
    ):
        yield one, other


@pytest.fixture
def browser(both: tuple[Gateway, Gateway]) -> Browser:
    """Return a browser on a world without a map."""
    browser = both[0].browser
    assert browser.http.delete(address(browser)).status_code == 204
    return browser


def address(browser: Browser) -> str:
    world = browser.page(str(browser.page(browser.root).one(LF.world)))
    return str(world.one(LF.map))


def put(browser: Browser, **more: str) -> Page:
    answer = upload(browser.http, address(browser), IMAGE, yaml(0.5, (1.0, -2.0, 0.0)), **more)
    assert answer.status_code == 204, answer.text
    return browser.page(address(browser))


def node(page: Page, predicate: rdflib.URIRef) -> rdflib.term.Node:
    (found,) = page.graph.objects(page.iri, predicate)
    return found


def number(page: Page, predicate: rdflib.URIRef) -> float:
    return float(str(page.graph.value(node(page, predicate), VOM.numericalValue)))


def conforms(browser: Browser, page: Page) -> None:
    (blueprint,) = (str(b) for b in page.graph.objects(page.iri, HYBRIT.blueprint) if str(b).startswith(browser.root))
    shapes = browser.page(blueprint).graph
    assert set(shapes.objects(None, SH.targetClass)) & set(page.graph.objects(page.iri, RDF.type))
    data, guard = (rdflib.Graph() + graph for graph in (page.graph, shapes))
    ok, _, text = pyshacl.validate(data, shacl_graph=guard, inference="none")
    assert ok, text


def test_without_a_map_its_resolution_and_its_place_are_unknown(browser: Browser) -> None:
    page = browser.page(address(browser))
    assert page.graph.value(node(page, LF.resolution), VOM.numericalValue) == LF.unknown
    assert page.graph.value(node(page, LF.position), MATHS.x) == LF.unknown
    assert str(page.one(DCTERMS.title)) == "No map of the floor"
    assert browser.http.get(page.url + "/map.pgm").status_code == 404
    conforms(browser, page)


def test_an_uploaded_map_says_what_it_is_where_it_lies_and_whose_it_is(browser: Browser) -> None:
    page = put(browser, title="Hall 2", height="2.5")
    assert str(page.one(DCTERMS.title)) == "Hall 2"
    assert number(page, LF.resolution) == 0.5
    position, size = node(page, LF.position), node(page, LF.size)
    assert [float(str(page.graph.value(position, axis))) for axis in (MATHS.x, MATHS.y, MATHS.z)] == [1.0, -2.0, 0.0]
    assert [float(str(page.graph.value(size, axis))) for axis in (MATHS.x, MATHS.y, MATHS.z)] == [2.0, 1.5, 2.5]
    counts = (LF.columns, LF.rows, LF.occupiedCells, LF.freeCells, LF.unknownCells, LF.obstacleBoxes)
    assert [int(str(page.one(each))) for each in counts] == [4, 3, 6, 4, 2, 2]
    assert page.graph.value(node(page, rdflib.PROV.wasAssociatedWith), DCTERMS.title) and page.one(DCTERMS.created)
    conforms(browser, page)


def test_without_a_title_a_map_is_called_like_its_image_and_obstacles_are_two_metres_high(browser: Browser) -> None:
    page = put(browser)
    assert str(page.one(DCTERMS.title)) == "floor"
    assert float(str(page.graph.value(node(page, LF.size), MATHS.z))) == 2.0


def test_its_files_can_be_loaded_by_map_server(browser: Browser) -> None:
    """The image is the same, byte by byte, and the YAML names it as a file beside it."""
    page = put(browser)
    image = browser.http.get(str(page.one(LF.mapImage)))
    assert image.content == IMAGE and image.headers["content-type"] == "image/x-portable-graymap"
    settings = browser.http.get(str(page.one(LF.mapSettings)))
    assert settings.headers["content-type"] == "application/yaml"
    assert settings.text.splitlines() == [
        "image: map.pgm", "mode: trinary", "resolution: 0.5", "origin: [1.0, -2.0, 0.0]", "negate: 0",
        "occupied_thresh: 0.65", "free_thresh: 0.196",
    ]  # fmt: skip
    again = upload(browser.http, page.url, image.content, settings.content, name="map.pgm")
    assert again.status_code == 204 and browser.http.get(str(page.one(LF.mapImage))).content == IMAGE
    picture = browser.http.get(str(page.one(LF.mapPicture)))
    assert picture.headers["content-type"] == "image/png" and picture.content.startswith(b"\x89PNG")


def test_the_image_is_sent_as_the_client_prefers_and_not_again(browser: Browser) -> None:
    url = str(put(browser).one(LF.mapImage))
    plain = browser.http.get(url, headers={"accept-encoding": "identity"})
    coded = browser.http.get(url, headers={"accept-encoding": "gzip"})
    assert "content-encoding" not in plain.headers and coded.headers["content-encoding"] == "gzip"
    assert plain.content == coded.content == IMAGE and plain.headers["etag"] != coded.headers["etag"]
    assert browser.http.get(url, headers={"if-none-match": plain.headers["etag"]}).status_code == 304
    assert browser.http.get(url, headers={"accept": "text/turtle"}).status_code == 406


def test_a_map_is_replaced_and_removed_only_in_the_state_that_the_client_knows(browser: Browser) -> None:
    page = put(browser)
    etag = browser.http.get(page.url, headers={"accept": "text/turtle"}).headers["etag"]
    assert browser.http.get(page.url, headers={"accept": "text/turtle", "if-none-match": etag}).status_code == 304
    assert upload(browser.http, page.url, IMAGE, if_match='"other"').status_code == 412
    assert upload(browser.http, page.url, IMAGE, if_match=etag).status_code == 204
    assert upload(browser.http, page.url, IMAGE, if_match=etag).status_code == 412
    assert browser.http.delete(page.url, headers={"if-match": etag}).status_code == 412
    assert browser.http.delete(page.url).status_code == 204
    assert browser.http.get(page.url + "/map.yaml").status_code == 404


def test_other_gateways_and_subscribers_hear_of_it(both: tuple[Gateway, Gateway], browser: Browser) -> None:
    other = both[1].browser
    with Socket(address(other)) as listening:
        assert "No map of the floor" in str(listening.raw())
        put(browser, title="Hall 3")
        assert "Hall 3" in str(listening.raw())
        image = eventually(lambda: other.http.get(address(other) + "/map.pgm"), "the image at the other gateway")
        assert image.content == IMAGE
        assert browser.http.delete(address(browser)).status_code == 204
        assert "No map of the floor" in str(listening.raw())


def test_queries_see_the_map(browser: Browser) -> None:
    put(browser, title="Hall 4")
    query = f"SELECT ?title WHERE {{ ?map a <{LF.OccupancyMap}> ; <{DCTERMS.title}> ?title }}"
    answer = browser.http.get(f"{browser.root}query", params={"query": query})
    assert "Hall 4" in answer.text, answer.text


@pytest.mark.parametrize(
    ("files", "status", "words"),
    [
        ({}, 400, "has no yaml"),
        ({"image": None}, 400, "has no image: send both files of the map, curl -X PUT"),
        ({"more": b"x"}, 400, "'more'; its fields are yaml, image, height, title"),
        ({"yaml": b"resolution: 1"}, 422, "has no image; a map has"),
        ({"yaml": yaml(image="other.pgm")}, 422, "names the image 'other.pgm', and the file sent is 'floor.pgm'"),
        ({"yaml": yaml(resolution=20.0)}, 422, "resolution of 20 m"),
        ({"image": b"\x89PNG"}, 422, "is no PGM"),
        ({"image": pgm(ROWS)[:-1]}, 422, "11 bytes of pixels; its columns and rows are 12"),
        ({"height": b"0"}, 422, "height of obstacles is a number of metres, above 0 and at most 100"),
        ({"height": b"1e9"}, 422, "height of obstacles"),
        ({"title": b"a\nb"}, 422, "title of a map is a line"),
    ],
)
def test_what_is_no_map_is_refused_with_a_sentence(
    browser: Browser, files: dict[str, bytes | None], status: int, words: str
) -> None:
    sent: dict[str, bytes | None] = {"yaml": yaml(), "image": IMAGE} | files if files else {"title": b"x"}
    form = [
        (name, (f"floor.{'pgm' if name == 'image' else name}" if name in ("yaml", "image") else None, content))
        for name, content in sent.items()
        if content is not None
    ]
    answer = browser.http.put(address(browser), files=form)
    assert (answer.status_code, words in answer.json()["detail"]) == (status, True), answer.text
    assert "constrainedBy" in answer.headers.get("link", "") or status == 400
    assert "No map of the floor" in browser.http.get(address(browser)).text


def test_a_body_that_is_no_form_or_too_long_is_refused(browser: Browser) -> None:
    url = address(browser)
    answer = browser.http.put(url, content="<> a <x> .", headers={"content-type": "text/turtle"})
    assert answer.status_code == 415 and answer.headers["accept"] == "multipart/form-data"
    assert browser.http.post(url, files={"yaml": b""}).status_code == 405, "a page of another site could send it"
    long = upload(browser.http, url, bytes(MAX_UPLOAD_BYTES))
    assert long.status_code == 413 and f"at most {MAX_UPLOAD_BYTES}" in long.json()["detail"]


def test_a_map_takes_the_right_to_administer_all_robots(tmp_path: Path) -> None:
    with run_authenticated(tmp_path, robots=False) as here:
        here.add("actor", "read", "act", "stop", "subscribe")
        here.add("local", "read", "admin", robots=("lab-*",))
        here.known("local")
        for name, status in (("actor", 403), ("local", 403), ("root", 204)):
            with here.browsing(name) as browser:
                url = f"{here.root}world/map"
                assert upload(browser.http, url, IMAGE).status_code == status
                assert browser.http.get(url + "/map.pgm").status_code == (200 if status == 204 else 404)
                assert browser.http.delete(url).status_code == status


def test_the_largest_map_is_taken_and_shared(both: tuple[Gateway, Gateway], browser: Browser) -> None:
    side = 4000
    row = bytes([WALL] + [FREE] * (side - 2) + [WALL])
    image = b"P5 4000 4000 255\n" + bytes(side) + row * (side - 2) + bytes(side)
    assert upload(browser.http, address(browser), image, yaml(0.05)).status_code == 204
    other = both[1].browser
    found = eventually(
        lambda: (answer := other.http.get(address(other) + "/map.pgm")).status_code == 200 and answer, "the image"
    )
    assert isinstance(found, httpx.Response) and found.content == image
