"""Nothing moves among things whose records cannot be read, until these are replaced or deleted."""

from collections.abc import Iterator
from pathlib import Path

import httpx
import pytest

from browser import LDP, LF, Browser
from commanding import TURTLE, WRIST, of_joint, radian
from redis_servers import Servers, single
from running import eventually, process
from scene_client import container, crate, put_object, put_robot
from small_fleet import Place, live

pytestmark = pytest.mark.virtual
RECORDS = "fleet:world:{@world}"


@pytest.fixture
def scene(tmp_path: Path) -> Iterator[tuple[Browser, Servers]]:
    """A UR5 with a placement."""
    place = Place(tmp_path)
    with single(tmp_path) as memory, process(*place.command(), "--redis-url", memory.url) as gateway:
        gateway.said("serving")
        browser = Browser(place.root)
        with place.ur5():
            live(browser, "ur5")
            put_robot(browser, "ur5", 0, 0, 0)
            yield browser, memory
        browser.close()


def damage(memory: Servers, table: str, id: str) -> None:
    """Replace a record, and tell the gateway."""
    (server,) = memory.nodes
    server.ask("HSET", f"{RECORDS}:{table}", id, "garbage")
    server.ask("XADD", f"{RECORDS}:news", "*", "table", table, "id", id)


def unreadable(browser: Browser, path: str) -> bool:
    """Return True if a motion is refused because of what is at the path."""
    answer = browser.http.post(of_joint(browser, WRIST), content=radian(0.1), headers=TURTLE)
    is_so = answer.status_code == 503 and answer.json()["detail"].endswith(f"{path} cannot be read; PUT or DELETE it.")
    assert is_so or "cannot be read" not in answer.text, answer.text
    return is_so


@pytest.mark.parametrize("way", ["PUT", "DELETE"])
def test_no_robot_moves_among_objects_that_cannot_be_read(scene: tuple[Browser, Servers], way: str) -> None:
    """The object is listed, says so, and can be replaced and deleted."""
    browser, memory = scene
    far = crate("far away", 20, 0, 0)
    path = httpx.URL(put_object(browser, far)).path
    assert "far away" in browser.http.get(container(browser).url).text
    damage(memory, "objects", path.rpartition("/")[2])
    eventually(lambda: unreadable(browser, path), "a refusal")
    listed = container(browser)
    assert [httpx.URL(str(each)).path for each in listed.graph.objects(listed.iri, LDP.contains)] == [path]
    url = browser.root + path[1:]
    for accepted in ("text/turtle", "text/html"):
        assert "An object that cannot be read" in browser.http.get(url, headers={"accept": accepted}).text
    answer = browser.http.request(way, url, content=far if way == "PUT" else None, headers=TURTLE)
    assert answer.status_code == 204, answer.text
    assert not unreadable(browser, path)
    after = browser.http.get(url)
    assert after.status_code == (200 if way == "PUT" else 404)
    assert ("far away" in after.text) == (way == "PUT")
    assert "cannot be read" not in browser.http.get(listed.url).text


def test_no_robot_moves_on_a_map_that_cannot_be_read(scene: tuple[Browser, Servers]) -> None:
    browser, memory = scene
    url = str(browser.page(str(browser.page(browser.root).one(LF.world))).one(LF.map))
    assert "No map of the floor" in browser.http.get(url).text
    damage(memory, "maps", "map")
    eventually(lambda: unreadable(browser, "/world/map"), "a refusal")
    assert "A map of the floor that cannot be read" in browser.http.get(url).text
    assert browser.http.delete(url).status_code == 204
    assert not unreadable(browser, "/world/map")
    assert "No map of the floor" in browser.http.get(url).text
