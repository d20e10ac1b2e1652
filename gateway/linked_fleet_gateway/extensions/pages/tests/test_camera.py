"""The page of a camera shows live pictures."""

from collections.abc import Iterator
from io import BytesIO

import pytest
from playwright.sync_api import Page, expect

from browser import Browser
from camera_robot import BLIND, EYE, CameraRobot
from fake_robots import FakeRobot, open_session
from running import eventually
from small_fleet import Place

pytestmark = [pytest.mark.processes, pytest.mark.test_all, pytest.mark.usefixtures("watched")]
Image = pytest.importorskip("PIL.Image")


@pytest.fixture(scope="module")
def seer(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[CameraRobot, str]]:
    place = Place(tmp_path_factory.mktemp("state"))
    with place.gateway() as (_, browser), open_session(place.zenoh) as session:
        seer = CameraRobot(FakeRobot(session, "seer")).appear(EYE)
        seer.contents["jpeg"] = picture("red")
        CameraRobot(FakeRobot(session, "blind")).appear(BLIND)
        for name in ("seer", "blind"):
            eventually(lambda name=name: there(browser, name), f"{name} with cameras")
        yield seer, f"{browser.root}seer/cameras/eye"


@pytest.fixture
def blind(seer: tuple[CameraRobot, str]) -> str:
    """A camera whose robot has no renderer."""
    return seer[1].replace("/seer/", "/blind/")


def there(browser: Browser, robot: str) -> bool:
    return browser.http.get(f"{browser.root}{robot}/cameras").status_code == 200


def picture(colour: str) -> bytes:
    to = BytesIO()
    Image.new("RGB", (EYE.width, EYE.height), colour).save(to, "JPEG")
    return to.getvalue()


SHOWS = """(channel) => {
  const canvas = document.createElement("canvas").getContext("2d");
  canvas.drawImage(document.querySelector("#seen > img"), 0, 0);
  return canvas.getImageData(1, 1, 1, 1).data[channel] > 200;
}"""


def test_the_page_shows_the_picture_and_each_that_follows(seer: tuple[CameraRobot, str], page: Page) -> None:
    robot, url = seer
    page.goto(url)
    page.wait_for_function(SHOWS, arg=0)
    robot.contents["jpeg"] = picture("blue")
    page.wait_for_function(SHOWS, arg=2)


def test_the_page_says_why_there_is_no_picture(blind: str, page: Page) -> None:
    page.goto(blind)
    expect(page.locator("main")).to_contain_text("nothing renders here")
    assert page.locator("#seen > img").count() == 0


def test_the_page_of_a_robot_has_thumbnails_of_what_its_cameras_see(seer: tuple[CameraRobot, str], page: Page) -> None:
    """Live while they are seen; each leads to the page of its camera."""
    robot, url = seer
    robot.contents["jpeg"] = picture("red")
    page.goto(url.partition("cameras")[0])
    thumbnail = page.locator(f'.thumbnails a[href="{url}"]')
    thumbnail.scroll_into_view_if_needed()
    shows = SHOWS.replace("#seen > img", ".thumbnails img")
    page.wait_for_function(shows, arg=0)
    robot.contents["jpeg"] = picture("blue")
    page.wait_for_function(shows, arg=2)
    thumbnail.click()
    expect(page).to_have_url(url)


def test_the_wall_shows_what_all_cameras_see(seer: tuple[CameraRobot, str], blind: str, page: Page) -> None:
    """Live while they are in view; a camera without pictures has none, and leads to its page, which says why."""
    robot, url = seer
    robot.contents["jpeg"] = picture("red")
    page.goto(url.partition("seer")[0] + "cameras")
    wall = page.locator("#wall a:has(.nothing)")
    expect(wall).to_have_count(2)
    page.wait_for_function(SHOWS.replace("#seen > img", f"a[data-camera='{url}'] img"), arg=0)
    expect(page.locator(f'#wall a[href="{blind}"]')).to_contain_text("nothing renders here")
    page.goto(url.rpartition("/")[0])
    expect(wall).to_have_count(1)
    page.get_by_role("link", name="Cameras of all robots").click()
    expect(wall).to_have_count(2)
