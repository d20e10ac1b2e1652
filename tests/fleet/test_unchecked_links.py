"""A robot whose mesh its agent does not have: named wherever "free" is said, and refused near others."""

from collections.abc import Iterator

import httpx
import pytest

from browser import LF, Browser
from mesh_package import write
from running import Process, eventually, process
from small_fleet import Place, live

pytestmark = pytest.mark.virtual
MESH = "package://p-with-dashes/meshes/nothere.stl"
ROTATE = "gappy/j/actions/rotate"
M, RAD = "http://qudt.org/vocab/unit/M", "http://qudt.org/vocab/unit/RAD"
BOX = "https://w3id.org/linked-fleet#Box"
NAMED = {"link": "gappy/tool", "mesh": MESH, "reason": "the agent does not offer it"}


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Place:
    return Place(tmp_path_factory.mktemp("unchecked"))


@pytest.fixture(scope="module")
def here(place: Place) -> Iterator[tuple[Process, Browser]]:
    urdf = write(place.state / "package", MESH)
    agent = ("-m", "linked_fleet_agent", f"--robot=gappy={urdf}", "--connect", place.zenoh)
    with place.gateway() as (gateway, browser), process(*agent):
        live(browser, "gappy")
        yield gateway, browser


@pytest.fixture
def browser(here: tuple[Process, Browser]) -> Iterator[Browser]:
    """Yield a browser on a world in which the robot stands alone at the origin."""
    browser = here[1]
    for each in browser.http.get(f"{browser.root}world/objects?as=jsonld").json().get("ldp:contains", ()):
        browser.http.delete(each["@id"] if isinstance(each, dict) else each)
    put_placement(browser)
    eventually(lambda: unchecked(browser) or None, "the unchecked links")
    yield browser


def put_placement(browser: Browser, **more: object) -> None:
    where = {"position": {"x": 0, "y": 0, "z": 0, "unit": M}}
    assert browser.http.put(f"{browser.root}gappy/placement", json=where | more).status_code in (200, 204)


def put_box(browser: Browser, x: float) -> str:
    size = {"x": 0.1, "y": 0.1, "z": 0.1, "unit": M}
    thing = {"title": "peg", "position": {"x": x, "y": 0, "z": 0, "unit": M}, "geometry": {"form": BOX, "size": size}}
    return browser.http.post(f"{browser.root}world/objects", json=thing).headers["location"]


def unchecked(browser: Browser) -> list[object]:
    page = browser.robot("gappy")
    return list(page.graph.objects(page.iri, LF.unchecked))


def turn(browser: Browser, prefer: str) -> httpx.Response:
    body = {"value": 0.3, "unit": RAD}
    return browser.http.post(f"{browser.root}{ROTATE}?as=json", json=body, headers={"prefer": prefer})


def local(links: list[dict[str, str]], browser: Browser) -> list[dict[str, str]]:
    return [each | {"link": each["link"].removeprefix(browser.root)} for each in links]


def test_the_robot_and_its_page_name_the_unchecked_link(browser: Browser) -> None:
    page = browser.robot("gappy")
    (node,) = page.graph.objects(page.iri, LF.unchecked)
    assert str(page.graph.value(node, LF.ofLink)) == f"{browser.root}gappy/tool"
    assert str(page.graph.value(node, LF.meshUri)) == MESH
    assert str(page.graph.value(node, LF.reason)) == "the agent does not offer it"
    html = browser.http.get(page.url, headers={"accept": "text/html"}).text
    assert "Not checked for collisions" in html and MESH in html


def test_the_response_to_the_placement_names_the_unchecked_link(browser: Browser) -> None:
    where = {"position": {"x": 0, "y": 0, "z": 0, "unit": M}}
    placement = f"{browser.root}gappy/placement"
    said = browser.http.put(placement, json=where, headers={"accept": "application/json"})
    assert said.status_code == 200 and local(said.json()["unchecked"], browser) == [NAMED]
    graph = browser.http.put(placement, json=where, headers={"accept": "text/turtle"})
    assert graph.status_code == 200 and MESH in graph.text and "lf:unchecked" in graph.text
    assert browser.http.put(placement, json=where, headers={"accept": "image/png"}).status_code == 204


def test_a_robot_alone_moves_and_every_answer_names_the_unchecked_link(browser: Browser) -> None:
    rehearsed = turn(browser, "dry-run")
    assert rehearsed.status_code == 200 and local(rehearsed.json()["unchecked"], browser) == [NAMED]
    begun = turn(browser, "return=representation")
    assert begun.status_code == 201
    held = browser.http.get(begun.headers["location"] + "?as=json").json()
    assert local(held["unchecked"], browser) == [NAMED]
    html = browser.http.get(begun.headers["location"], headers={"accept": "text/html"}).text
    assert "Not checked for collisions" in html


def test_a_motion_near_an_object_is_refused_unless_the_placement_accepts_that(browser: Browser) -> None:
    peg = put_box(browser, 0.5)
    for prefer in ("dry-run", "return=minimal"):
        refused = turn(browser, prefer)
        assert refused.status_code == 409 and refused.json()["type"].endswith("#unchecked-links"), refused.text
        assert "peg" in refused.json()["detail"] and "lf:acceptsUnchecked" in refused.json()["detail"]
        assert local(refused.json()["unchecked"], browser) == [NAMED]
    body, html = {"value": 0.3, "unit": RAD}, {"accept": "text/html", "prefer": "dry-run"}
    assert MESH in browser.http.post(browser.root + ROTATE, json=body, headers=html).text
    put_placement(browser, acceptsUnchecked=True)
    assert browser.http.get(f"{browser.root}gappy/placement?as=json").json()["acceptsUnchecked"] is True
    assert local(turn(browser, "dry-run").json()["unchecked"], browser) == [NAMED]
    put_placement(browser)
    assert turn(browser, "dry-run").status_code == 409
    assert browser.http.delete(peg).status_code == 204
    assert turn(browser, "dry-run").status_code == 200
